"""Random apparatuses of the live page, and their runs by the reference and by the JavaScript."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.live.write import live_settings
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solution import Solution
from looping_pendulum.reference_ode.transitions import Event

DURATION = 5.0
FRACTIONS = np.linspace(0.0, 1.0, 101)
"""Fractions of the reference's end time at which the paths are compared."""
OF_FURTHER_EFFECTS = {
    "light_linear_drag": (0.0, 0.01),
    "heavy_linear_drag": (0.0, 0.05),
    "wind_speed": (-2.0, 2.0),
    "side_force": (-0.02, 0.02),
    "push_across": (-1.0, 1.0),
    "push_along": (-1.0, 1.0),
}
"""Coefficient -> range; in every third apparatus each is there or not."""
MAX_TIME_DIFFERENCE = 1e-8
"""Of an event [s]; so much can heyoka itself be off where a speed returns to zero slowly (measured against 80-bit numbers)."""
MAX_PATH_DIFFERENCE = 1e-7
"""Of a position up to the end [m], as between heyoka and SciPy."""
_RUN_CASE, _BITS_OF = (
    Path(__file__).with_name(name).read_text(encoding="utf-8").replace("export ", "")
    for name in ("run_case.mjs", "bits_of.mjs")
)
IN_PAGE = {
    "run_cases.mjs": f"(cases) => {{ {_RUN_CASE} return cases.map((item) => runCase(loopingPendulum.simulate, item)); }}",
    "bits.mjs": f"""async (jobs) => {{
      {_BITS_OF}
      const results = [];
      for (const job of jobs) results.push(await bitsOf(loopingPendulum.Core, loopingPendulum.DRIVER, job));
      return results;
    }}""",
}
"""Module for Node -> the function of a page, in which the script is, that does the same."""
RELEASES = (*Release, Release.LOOPING, Release.LOOPING)
"""Releases of successive threes; half of all are looping ones."""
ROUNDING_SPEED = 1e-9
"""Speed across the string below which a light mass hangs straight down [m/s]: measured at most 1e-13, and else above 1e-2."""


def random_apparatus(rng: np.random.Generator, place: int) -> Parameters:
    """Return an apparatus within the ranges of the page's sliders; every third has some of the further effects."""
    light_mass = math.exp(rng.uniform(math.log(0.005), 0.0))
    friction = rng.uniform(0.0, 0.8)
    coefficients = {
        "kinetic_friction": friction,
        "static_friction": friction * rng.uniform(1.0, 1.5),
        # From none to several times those of the shipped scenarios
        "light_drag": rng.uniform(0.0, 3e-3),
        "heavy_drag": rng.uniform(0.0, 3e-3),
        "string_drag": rng.uniform(0.0, 2e-2),
    }
    if place % 3 == 2:
        coefficients |= {name: rng.uniform(*bounds) for name, bounds in OF_FURTHER_EFFECTS.items() if rng.random() < 0.5}
    return Parameters(
        light_mass=light_mass,
        heavy_mass=light_mass * rng.uniform(1.0, 30.0),
        rod_radius=rng.uniform(0.002, 0.03),
        free_length=rng.uniform(0.1, 1.5),
        release_angle=math.radians(rng.uniform(20.0, 170.0)),
        hanging_length=rng.uniform(0.02, 0.2),
        release=RELEASES[place // 3 % len(RELEASES)],
        coefficients=coefficients,
    )


def case_of(p: Parameters, end_time: float) -> dict[str, Any]:
    """Return the case that the JavaScript is to run."""
    return {"settings": live_settings(p), "duration": DURATION, "times": (FRACTIONS * end_time).tolist()}


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """How far a live run is from the reference."""

    same_events: bool
    time_difference: float
    """Largest difference of an event's time [s]; infinite with other events."""
    path_difference: float
    """Largest distance between the positions of a mass at equal times [m]."""

    @property
    def agrees(self) -> bool:
        """Whether the runs are the same within the bounds that the live page promises."""
        return self.same_events and self.time_difference <= MAX_TIME_DIFFERENCE and self.path_difference <= MAX_PATH_DIFFERENCE


def hangs_straight(reference: Solution) -> bool:
    """Return whether the light mass moves only up and down; the sign of its speed across the string is then rounding."""
    samples = reference.sample(FRACTIONS * reference.end_time)
    return bool(np.max(np.abs(samples.state.across_speed)) < ROUNDING_SPEED)


def compare(reference: Solution, live: dict[str, Any]) -> Comparison:
    """Compare a live run with that of the reference; reversals of a mass that hangs straight down are left out."""
    left_out = Event.ACROSS_REVERSES if hangs_straight(reference) else ""
    expected = [(e.event, e.mode_after.name.lower(), e.time) for e in reference.events if e.event != left_out]
    events = [(e["event"], e["modeAfter"], e["time"]) for e in live["events"] if e["event"] != left_out]
    same = [e[:2] for e in expected] == [e[:2] for e in events]
    times, live_times = (np.array([e[2] for e in several]) for several in (expected, events))
    samples = reference.sample(FRACTIONS * reference.end_time)
    gaps = [
        np.hypot(*(np.array([s[name] for s in live["samples"]]) - position).T)
        for name, position in (("light", samples.light_position), ("heavy", samples.heavy_position))
    ]
    return Comparison(
        same_events=same,
        time_difference=float(np.max(np.abs(times - live_times))) if same else math.inf,
        path_difference=float(np.max(gaps)),
    )

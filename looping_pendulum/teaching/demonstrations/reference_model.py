"""Demonstrations with the exact model alone: what a law of friction, a drag or a thickness does to the motion."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.closed_forms import halted_free_length, spiral
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.demonstrations.demonstration import (
    LARGEST_DROP,
    PARAMETERS,
    TEN_TO_ONE,
    Claim,
    Demonstration,
    DemonstrationFigure,
    MeasuredColumn,
    MeasuredValues,
    Runs,
    curves_over_time,
    drop_curves,
    halting_time,
    halting_time_of,
    reference_case,
    rms_distance,
)

FRAME = 1e3 / 240
"""Time between two frames of a phone's slow motion [ms]."""


def _event(name: str) -> Any:
    """Return a measure of the time of the first event ``name`` [s]."""

    def measure(runs: Runs, key: str) -> float | None:
        return next((e.time for e in runs[key].events if e.name == name), None)

    return measure


def _earlier(name: str, than: str) -> Any:
    """Return a measure of how much earlier than in case ``than`` the first event ``name`` is [ms]."""

    def measure(runs: Runs, key: str) -> float | None:
        own, other = _event(name)(runs, key), _event(name)(runs, than)
        return None if key == than or own is None or other is None else 1e3 * (other - own)

    return measure


TWO_TO_ONE: Scenario = load("two_to_one")
STATIC_OVER_KINETIC = (1.0, 1.2, 1.5)
"""Ratios of static to kinetic friction."""


def _with_static_friction(ratio: float) -> Scenario:
    kinetic = TWO_TO_ONE.parameters.coefficients["kinetic_friction"]
    parameters = TWO_TO_ONE.parameters.replace(static_friction=ratio * kinetic)
    return replace(TWO_TO_ONE, parameters=parameters, duration=2.5)


def _ratio_holds(n: MeasuredValues) -> bool:
    same = abs(n["stick"]["r1.2"] - n["stick"]["r1.0"]) < 1e-9  # as far as the reference's times are computed
    return bool(n["away"]["r1.2"] > n["away"]["r1.0"] + 2e-3 and same)


BREAK_AWAY = Demonstration(
    name="break-away",
    title="Static against kinetic friction at the break-away",
    question="A resting string grips better than a sliding one. When does that matter?",
    guess="A better grip makes everything stop earlier.",
    experiment=(
        "The exact reference of the 2:1 trial, where the string sticks, slips again and sticks for good, with a static "
        "friction 1, 1.2 and 1.5 times the kinetic one."
    ),
    scenario="two_to_one",
    change="string:\n  kinetic_friction: 0.26764\n  static_friction: 0.33    # found by trial: where does the motion change?",
    commands=("looping-pendulum run mine.yaml",),
    cases=lambda: tuple(
        reference_case(_with_static_friction(ratio), f"r{ratio}", f"static / kinetic = {ratio:g}", main=ratio == 1)
        for ratio in STATIC_OVER_KINETIC
    ),
    quantities=(
        MeasuredColumn(key="stop", header="first stop [s]", measure=_event("stop"), digits=".4f"),
        MeasuredColumn(key="stick", header="sticks first [s]", measure=_event("stick"), digits=".4f"),
        MeasuredColumn(key="away", header="slips again [s]", measure=_event("slip_onset"), digits=".4f"),
        halting_time(TWO_TO_ONE.parameters),
        LARGEST_DROP,
    ),
    claims=(
        Claim(
            words="While the string slides, static friction does nothing: all three come to their first stop at "
            "{stop[r1.0]:.4f} s.",
            holds=lambda n: max(n["stop"].values()) - min(n["stop"].values()) < 1e-6,
        ),
        Claim(
            words="At 1.2 it only delays the break-away, from {away[r1.0]:.4f} s to {away[r1.2]:.4f} s.",
            holds=_ratio_holds,
        ),
        Claim(
            words="At 1.5 the story is another one: the string already holds at the first stop ({stick[r1.5]:.4f} s), where "
            "before it ran back, and the heavy mass falls {lowest[r1.5]:.1f} cm at most instead of {lowest[r1.0]:.1f} cm. A "
            "threshold, not a gradual change: a fit that follows slopes cannot see it coming.",
            holds=lambda n: n["stick"]["r1.5"] < n["stick"]["r1.0"] - 0.05 and n["lowest"]["r1.5"] < n["lowest"]["r1.0"] - 1,
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="M2 has fallen by [cm]",
        caption="The heavy mass's way down for three static frictions: nothing differs until the string first rests.",
        curves=drop_curves,
    ),
)


DRAGS = ("light_drag", "heavy_drag", "string_drag")


def _with_drag(times: float) -> Scenario:
    changed = {name: times * PARAMETERS.coefficients[name] for name in DRAGS}
    return replace(TEN_TO_ONE, parameters=PARAMETERS.replace(**changed), duration=2.0)


def _distance_from_spiral(runs: Runs, key: str) -> float:
    """Return the largest distance of the light mass's path after the halt from the closed-form spiral [mm]."""
    run: Trajectory = runs[key]
    halt = halting_time_of(run, PARAMETERS)
    assert halt is not None
    after = run.t > halt
    rho, psi = spiral(
        run.wrap_angle[after],
        halt_length=float(run.free_length[after][0]),
        halt_angle=float(run.wrap_angle[after][0]),
        rod_radius=PARAMETERS.rod_radius,
    )
    places = rho[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)
    return 1e3 * float(np.linalg.norm(places - run.light_position[after], axis=1).max())


def _free_length_error(runs: Runs, key: str) -> float:
    """Return the largest error of the free length by the formula without gravity and drag, given the run's end [mm]."""
    run: Trajectory = runs[key]
    halt, end = halting_time_of(run, PARAMETERS), _event("light_reaches_rod")(runs, key)
    assert halt is not None
    after = (run.t > halt) & (run.t < end)
    t, length = run.t[after], run.free_length[after]
    formula = halted_free_length(t, halt_length=float(length[0]), halt_time=float(t[0]), end_time=end)
    return 1e3 * float(np.abs(formula - length).max())


DRAG = Demonstration(
    name="drag-and-spiral",
    title="Drag makes the spiral right",
    question="After the halt the light mass winds in on a spiral. The air's drag on 10 g is tiny: may it be left out?",
    guess="A drag of a few 1e-4 kg/m changes nothing that one could see on a video.",
    experiment=(
        "The exact reference of the 10:1 trial without drag, with the drag that the scenario has, and with twice that. The "
        "path after the halt is held against the closed-form spiral, l + R theta = constant; the times against each other."
    ),
    scenario="ten_to_one",
    change="light:\n  drag: 0 kg/m\nheavy:\n  drag: 0 kg/m",
    commands=("looping-pendulum run mine.yaml --out runs/mine",),
    cases=lambda: (
        reference_case(_with_drag(1.0), "declared", "drag as in the scenario"),
        reference_case(_with_drag(0.0), "none", "no drag", main=False),
        reference_case(_with_drag(2.0), "double", "twice the drag", main=False),
    ),
    quantities=(
        halting_time(PARAMETERS),
        MeasuredColumn(key="end", header="M1 reaches the rod [s]", measure=_event("light_reaches_rod"), digits=".4f"),
        MeasuredColumn(
            key="earlier", header="earlier by [ms]", measure=_earlier("light_reaches_rod", "declared"), digits="+.1f"
        ),
        MeasuredColumn(key="halt_earlier", header="halts earlier by [ms]", measure=_earlier("halt", "declared"), digits="+.1f"),
        MeasuredColumn(
            key="apart",
            header="M1 from the declared run to 1.0 s [mm]",
            measure=lambda runs, key: rms_distance(runs, key, "declared", 1.0),
            digits=".1f",
        ),
        MeasuredColumn(
            key="spiral", header="path off the closed-form spiral [mm]", measure=_distance_from_spiral, digits=".1e"
        ),
        MeasuredColumn(
            key="clock",
            header="free length off the formula without gravity and drag [mm]",
            measure=_free_length_error,
            digits=".1f",
        ),
    ),
    claims=(
        Claim(
            words="The shape of the spiral knows nothing of drag: with and without it the path is the closed form's, to "
            "{spiral[declared]:.0e} mm and {spiral[none]:.0e} mm.",
            holds=lambda n: max(n["spiral"].values()) < 1e-6,
        ),
        Claim(
            words="The clock does. Without drag the light mass reaches the rod {earlier[none]:.1f} ms earlier, which is more "
            "than 5 frames at 240 a second, and is {apart[none]:.0f} mm from where it should be (root mean square to 1.0 s).",
            holds=lambda n: n["earlier"]["none"] > 5 * FRAME and n["apart"]["none"] > 5,
        ),
        Claim(
            words="The halt hardly tells: it moves by {halt_earlier[none]:.1f} ms, less than one frame. So a model that is "
            "right up to the halt may still lack the drag.",
            holds=lambda n: 0 < n["halt_earlier"]["none"] < FRAME,
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="M1's height [cm]",
        caption="The light mass's height. The three agree up to the halt; then less drag runs ahead, loop by loop.",
        curves=curves_over_time(lambda run: 100 * run.light_position[:, 1]),
    ),
)

SLIPPERY_FRICTION = 0.05
"""Friction coefficient of a slippery rod, on which the string still slides after a whole turn."""
STRING_ON_STRING_FRICTION = 0.1
"""Friction coefficient that string on string adds, per radian beyond the first turn."""
THICKNESS_PER_TURN = 5e-4
"""Growth of the wound radius per turn [m]."""


def _with_coefficients(**changes: float) -> Scenario:
    return replace(TEN_TO_ONE, parameters=PARAMETERS.replace(**changes), duration=2.0)


def _turns_at_halt(runs: Runs, key: str) -> float | None:
    """Return the wrap angle when the heavy mass halts [deg]."""
    run: Trajectory = runs[key]
    halt = halting_time_of(run, PARAMETERS)
    return None if halt is None else math.degrees(float(np.interp(halt, run.t, run.wrap_angle)))


STRING_ON_STRING = Demonstration(
    name="string-on-string",
    title="The string that winds on itself",
    question="After a full turn the string lies on string, which grips better than the rod, and makes it thicker. Does it "
    "matter?",
    guess="Better grip and a thicker rod stop the heavy mass earlier.",
    experiment=(
        f"The exact reference, with a friction of {STRING_ON_STRING_FRICTION:g} per radian added where string lies on "
        f"string, and with a string that makes the rod {1e3 * THICKNESS_PER_TURN:g} mm thicker per turn; on the rod of the "
        f"10:1 trial and on a slippery one (friction {SLIPPERY_FRICTION:g})."
    ),
    scenario="ten_to_one",
    change="string:\n  kinetic_friction: 0.05\n  static_friction: 0.05\neffects:\n  string_on_string: 0.1",
    commands=("looping-pendulum run mine.yaml",),
    cases=lambda: (
        reference_case(_with_coefficients(), "plain", "10:1 trial"),
        reference_case(
            _with_coefficients(string_on_string=STRING_ON_STRING_FRICTION), "grip", "string grips string", main=False
        ),
        reference_case(_with_coefficients(string_thickness=THICKNESS_PER_TURN), "thick", "string thickens the rod", main=False),
        reference_case(_with_coefficients(kinetic_friction=SLIPPERY_FRICTION), "slippery", "slippery rod", main=False),
        reference_case(
            _with_coefficients(kinetic_friction=SLIPPERY_FRICTION, string_on_string=STRING_ON_STRING_FRICTION),
            "slippery_grip",
            "slippery rod, string grips string",
            main=False,
        ),
    ),
    quantities=(
        halting_time(PARAMETERS),
        MeasuredColumn(key="stick", header="string first holds [s]", measure=_event("stick"), digits=".3f"),
        MeasuredColumn(key="away", header="slips again [s]", measure=_event("slip_onset"), digits=".3f"),
        MeasuredColumn(key="angle", header="string on the rod at the halt [deg]", measure=_turns_at_halt, digits=".0f"),
        LARGEST_DROP,
        MeasuredColumn(key="end", header="M1 reaches the rod [s]", measure=_event("light_reaches_rod"), digits=".3f"),
        MeasuredColumn(key="earlier", header="earlier by [ms]", measure=_earlier("light_reaches_rod", "plain"), digits="+.1f"),
    ),
    claims=(
        Claim(
            words="In the 10:1 trial the grip of string on string does nothing: the heavy mass halts with {angle[plain]:.0f} "
            "deg of string on the rod, before the first turn is complete.",
            holds=lambda n: n["angle"]["plain"] < 360 and abs(n["halt"]["grip"] - n["halt"]["plain"]) < 1e-6,
        ),
        Claim(
            words="On a slippery rod it decides the end: without it the string first holds at {stick[slippery]:.3f} s and "
            "slips again at {away[slippery]:.3f} s; with it, it holds for good from {halt[slippery_grip]:.3f} s on, "
            "{angle[slippery_grip]:.0f} deg being on the rod.",
            holds=lambda n: (
                n["away"]["slippery"] is not None
                and n["halt"]["slippery_grip"] is not None
                and n["halt"]["slippery_grip"] < n["stick"]["slippery"]
                and n["angle"]["slippery_grip"] > 360
            ),
        ),
        Claim(
            words="The thickness does not move the halt, but what follows: string is used up faster on a thicker rod, and "
            "the light mass arrives {earlier[thick]:.0f} ms earlier.",
            holds=lambda n: n["earlier"]["thick"] > 5 * FRAME and abs(n["halt"]["thick"] - n["halt"]["plain"]) < 1e-6,
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="M2 has fallen by [cm]",
        caption="The heavy mass's way down. On the rod of the trial the lines lie on one another; on the slippery rod string "
        "on string makes the difference.",
        curves=drop_curves,
    ),
)

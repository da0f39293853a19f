"""Measurements of Newton's tendon, which compiles itself first and so is left out of the daily tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import MemoryRecorder, Profile
from looping_pendulum.engines.tension import measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios import load
from scripts.measurements.engines import engine

NAME = "newton:tendon"
WRAP_ANGLES = (90, 135, 180)
"""Wrap angles of the static test [deg]."""
END_TIMES = (0.1, 0.2, 0.29)
"""Ends of the times over which the distance from the reference is averaged [s]; soon after the last the run is ended."""
COMPLIANCES = (0.0, 1e-6, 1e-5, 1e-4, 1e-3)
"""[m/N]"""


def newton_tendon() -> dict[str, Any]:
    """Return errors of the capstan exponent and of the 10:1 trial for both profiles, and the exponent for compliances."""
    return {
        **{profile.value: _static(profile) | _trial(profile) for profile in Profile},
        "compliance": {f"{value:g}": _exponent_error(180, compliance=value) for value in COMPLIANCES},
    }


def _static(profile: Profile) -> dict[str, Any]:
    return {"static": {f"{degrees}": _exponent_error(degrees, profile) for degrees in WRAP_ANGLES}}


def _exponent_error(degrees: float, profile: Profile = Profile.QUICK, **changes: float) -> float | str:
    """Return the relative error of ln(T2 / T1) at a wrap angle; a sentence if the string does not slide."""
    try:
        return measure_capstan_exponent(engine(NAME, profile, **changes), wrap_angle=math.radians(degrees)).error
    except EngineError as error:
        if "did not slide" not in str(error):
            raise
        return "does not slide"


def _trial(profile: Profile) -> dict[str, Any]:
    """Return where the 10:1 trial is ended, and the light mass's distance from the reference until then."""
    scenario, recorder = load("ten_to_one"), MemoryRecorder()
    try:
        engine(NAME, profile).simulate(scenario, recorder)
    except EngineError as error:
        if "beyond half a turn" not in str(error):
            raise
    rows = recorder.rows()
    exact = solve_at(scenario.parameters, rows[:, 0], duration=rows[-1, 0] + 0.01)
    distances = np.linalg.norm(rows[:, 1:3] - exact.light_position, axis=1)
    rms = {f"{end:g}s": math.sqrt(np.mean(distances[rows[:, 0] <= end + 1e-9] ** 2)) for end in END_TIMES}
    return {"rms": rms, "ended_at": rows[-1, 0]}

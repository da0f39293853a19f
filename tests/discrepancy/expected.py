"""Expected result for each blind case: the candidate's name and its planted value."""

from __future__ import annotations

from tests.blind.cases import CASES

DECISIVE = 10.0
"""Difference of the Bayesian information criterion that decides: odds of exp(10 / 2), 148 to 1.

Kass and Raftery (J. Am. Stat. Assoc. 90 (1995) 773) call it very strong. Tests take it from here and not from the search, whose
own limits are what they test.
"""


def _hidden(case: str) -> float:
    c = CASES[case]
    return (c.effects + c.apparatus_errors + c.camera_errors)[0][1]


EXPECTED = {
    "linear_drag": ("light_linear_drag", _hidden("linear_drag")),
    "wind": ("wind_speed", _hidden("wind")),
    "attitude_drag": ("attitude_drag", _hidden("attitude_drag")),
    "static_excess": ("static_friction", 1 + _hidden("static_excess")),
    "friction_per_speed": ("friction_per_speed", _hidden("friction_per_speed")),
    "friction_per_wrap": ("friction_per_wrap", _hidden("friction_per_wrap")),
    "string_on_string": ("string_on_string", _hidden("string_on_string")),
    "string_density": ("string_density", _hidden("string_density")),
    "compliance": ("string_compliance", _hidden("compliance")),
    "string_thickness": ("string_thickness", _hidden("string_thickness")),
    "rod_mobility": ("rod_mobility", _hidden("rod_mobility")),
    "heavy_swing": ("heavy_swing", _hidden("heavy_swing")),
    "sideways_push": ("push_sideways", _hidden("sideways_push")),
    "side_force": ("side_force", _hidden("side_force")),
    "side_stiffness": ("side_stiffness", _hidden("side_stiffness")),
    "push": ("push_across", _hidden("push")),
    "wrong_mass": ("wrong_light_mass", 1 + _hidden("wrong_mass")),
    "wrong_length": ("wrong_free_length", 1 + _hidden("wrong_length")),
    "wrong_gravity": ("wrong_gravity", 9.81 * (1 + _hidden("wrong_gravity"))),
    "scale": ("scale", 1 + _hidden("scale")),
    "tilt": ("tilt", -_hidden("tilt")),  # the operator's axes turn, so the picture turns the other way
    "clock_offset": ("clock_offset", -_hidden("clock_offset")),
    "frame_rate": ("clock_ratio", 1 / (1 + _hidden("frame_rate"))),
}
"""Blind case -> name of the candidate, and planted value in that candidate's unit."""

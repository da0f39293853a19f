"""Expected result for each blind case: the candidate's name and its planted value, or its law."""

from collections.abc import Callable, Iterable

from looping_pendulum.discrepancy.evidence.explanation import Parts
from looping_pendulum.discrepancy.evidence.laws import body_of
from looping_pendulum.discrepancy.result import RankedExplanation
from tests.blind.cases import CASES, Case

DECISIVE = 10.0
"""Difference of the Bayesian information criterion that decides: odds of exp(10 / 2), 148 to 1.

Kass and Raftery (J. Am. Stat. Assoc. 90 (1995) 773) call it very strong. Tests take it from here and not from the search, whose
own limits are what they test.
"""


CANDIDATES = {
    "linear_drag": "light_linear_drag",
    "wind": "wind_speed",
    "attitude_drag": "attitude_drag",
    "static_excess": "static_friction",
    "friction_per_speed": "friction_per_speed",
    "friction_per_wrap": "friction_per_wrap",
    "string_on_string": "string_on_string",
    "string_density": "string_density",
    "compliance": "string_compliance",
    "string_thickness": "string_thickness",
    "rod_mobility": "rod_mobility",
    "heavy_swing": "heavy_swing",
    "sideways_push": "push_sideways",
    "side_force": "side_force",
    "side_stiffness": "side_stiffness",
    "push": "push_across",
    "wrong_mass": "wrong_light_mass",
    "wrong_length": "wrong_free_length",
    "wrong_gravity": "wrong_gravity",
    "scale": "scale",
    "tilt": "tilt",
    "clock_offset": "clock_offset",
    "frame_rate": "clock_ratio",
}
"""Blind case -> name of the candidate."""

CONVERSIONS: dict[str, Callable[[float], float]] = {
    "static_excess": lambda hidden: 1 + hidden,
    "wrong_mass": lambda hidden: 1 + hidden,
    "wrong_length": lambda hidden: 1 + hidden,
    "wrong_gravity": lambda hidden: 9.81 * (1 + hidden),
    "scale": lambda hidden: 1 + hidden,
    "tilt": lambda hidden: -hidden,  # the operator's axes turn, so the picture turns the other way
    "clock_offset": lambda hidden: -hidden,
    "frame_rate": lambda hidden: 1 / (1 + hidden),
}
"""Case -> planted value in the candidate's unit, from the hidden number; the hidden number itself for all others."""


def hidden_number(case: Case) -> float:
    """Return the first hidden number of a case, which may have been scaled."""
    return (case.effects + case.apparatus_errors + case.camera_errors)[0][1]


def planted(case: Case) -> tuple[str, float]:
    """Return the candidate's name and the planted value of a case with one hidden effect, which may have been scaled."""
    return CANDIDATES[case.name], CONVERSIONS.get(case.name, float)(hidden_number(case))


EXPECTED = {name: planted(CASES[name]) for name in CANDIDATES}
"""Blind case -> name of the candidate, and planted value in that candidate's unit."""

PLANTED_LAWS = {
    "thrust": ("light mass", "time"),
    "magnet": ("light mass, away from a point", "distance"),
    "brake": ("heavy mass", "hanging_length"),
    "rough_patch": ("string on rod", "wrap_angle"),
    "late_patch": ("string on rod", "wrap_angle"),
    "friction_per_turn": ("string on rod", "wrap_angle"),
    "pull": ("light mass, away from a point", "distance"),
}
"""Case that no library lists -> what its law acts on, and the coordinate that it is a function of."""

Explained = tuple[frozenset[str], tuple[str, str] | None]
"""An explanation: its listed effects, and the body and coordinate of its law; None: it has no law."""
NOTHING: Explained = frozenset(), None


def truth(hidden: Iterable[str]) -> Explained:
    """Return what is hidden in a study, given as the names of blind cases, as an explanation."""
    names = tuple(hidden)
    laws = [PLANTED_LAWS[name] for name in names if name in PLANTED_LAWS]
    effects = frozenset(CANDIDATES[name] for name in names if name in CANDIDATES)
    return effects, (body_of(laws[0][0]), laws[0][1]) if laws else None


def parts_of(e: RankedExplanation | Parts) -> Explained:
    """Return the effects of an explanation, and the body and coordinate of its law, whatever its direction and factor."""
    return frozenset(effect.name for effect in e.effects), (body_of(e.law.target), e.law.coordinate) if e.law else None

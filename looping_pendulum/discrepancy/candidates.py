"""Candidates for what a declared model lacks or has wrong: effects of the library, values of the apparatus, camera errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from looping_pendulum.measured.camera import BENDING, CAMERA
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.study import EARTH_GRAVITY, Study, can_act
from looping_pendulum.measured.study_file import WRONG
from looping_pendulum.reference_ode.effects import COEFFICIENTS, Coefficient, Effect, EffectKind
from looping_pendulum.reference_ode.effects.own import multiplied_coefficient
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release

APPARATUS = MappingProxyType(
    {
        "light_mass": "true over stated light mass (only the ratio of the masses moves anything)",
        "free_length": "true over stated free length, the same in all trials",
        "rod_radius": "true over stated radius of the rod",
    }
)
"""Parameter that may be wrong by a factor -> meaning of the factor."""
FACTOR_BOUNDS = (0.5, 2.0)
"""Smallest and largest factor."""
COMPANION_STARTS = 5
"""Number of initial values of a companion that are tried."""
MIN_SHARE_OF_MULTIPLIED = 0.01
"""Smallest value of what a candidate multiplies, as a share of its initial value, that the candidate is tried beside."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A parameter that could be added to the model; its null value stands for an absent effect or a right value."""

    name: str
    """Name in reports, for example "wrong_free_length"."""
    parameter: str
    """Parameter or coefficient that it changes."""
    role: ParameterRole
    """How it enters that parameter."""
    null: float
    """Value without any effect [SI]."""
    bounds: tuple[float, float]
    """Physically possible values [SI]."""
    unit: str
    """SI unit; '' if dimensionless."""
    kind: str
    """Kind of effect, "wrong value" or "measurement error"."""
    acts_on: str
    depends_on: tuple[str, ...]
    formula: str
    source: str
    trials: tuple[str, ...]
    """Names of the trials in which it acts."""
    direction: str = ""
    """Axis along which its force acts, if there is one."""
    bounds_reason: str = ""
    """Why the value cannot leave its bounds, where that is more than what the effect is; empty: it is not."""
    multiplies: str = ""
    """Coefficient of the model that it is proportional to; '': none."""
    even: bool = False
    """Whether the opposite value does the same, so that a fit takes values above the null one only."""
    stated_error: float = math.nan
    """Standard error of the value of which it is a factor, in units of that value; nan: it is no factor on a stated value."""
    companions: tuple[Coefficient, ...] = ()
    """Coefficients that shape the effect which this one switches on, and are fitted with it."""

    def companion_grid(self) -> tuple[tuple[float, ...], ...]:
        """Return initial values of the companions [SI]: combinations of half decades below the largest possible values."""
        if not self.companions:
            return ((),)
        grids = [[c.bounds[1] * 10 ** (-0.5 * i) for i in range(1, COMPANION_STARTS + 1)] for c in self.companions]
        return tuple(itertools.product(*grids))

    def companion_parameters(self, values: Sequence[float]) -> tuple[FreeParameter, ...]:
        """Return the companions as free parameters with the initial ``values`` [SI]."""
        return tuple(
            FreeParameter(name=c.name, parameter=c.name, trials=self.trials, init_value=v, scale=0.5 * v, bounds=c.bounds)
            for c, v in zip(self.companions, values, strict=True)
        )

    def where_it_acts(self, parameters: Sequence[FreeParameter], x: Array) -> Array:
        """Return the free parameters ``x`` with what this candidate multiplies at its initial value if it is zero there."""
        x = x.copy()
        for i, n in enumerate(parameters):
            if n.parameter == self.multiplies and n.init_value + n.scale * x[i] < MIN_SHARE_OF_MULTIPLIED * n.init_value:
                x[i] = 0.0  # the initial value
        return x

    def free_parameter(self, scale: float) -> FreeParameter:
        """Return the candidate as a free parameter that starts at its null value; ``scale`` is in SI units."""
        bounds = (self.null, self.bounds[1]) if self.even else self.bounds
        return FreeParameter(
            name=self.name, parameter=self.parameter, role=self.role, trials=self.trials, init_value=self.null,
            scale=scale, bounds=bounds,
        )  # fmt: skip


def candidates(study: Study, fitted: Iterable[FreeParameter], camera: Iterable[str]) -> tuple[Candidate, ...]:
    """Return everything that could be added to a model.

    Parameters
    ----------
    fitted
        Free parameters that the model has already.
    camera
        Names of the camera parameters that all trials depend on.
    """
    # By the role as well: a fitted parameter may still be wrong by a factor
    taken = {(n.parameter, n.role) for n in fitted}
    # What a careful set-up leaves of these is fitted to films; a camera that looks from aside has more
    taken -= {(name, ParameterRole.CAMERA) for name in BENDING}
    trials = tuple(t.name for t in study.trials)
    releases = {t.release for t in study.trials}
    nulls = {name: c.null for name, c in study.coefficients.items()}
    listed = []
    for effect in study.known_effects:
        if effect.kind is EffectKind.CLOSURE or not any(can_act(effect, r) for r in releases):
            continue
        # All but the first coefficient of a further effect only shape what the first one switches on
        listed += [
            _effect_candidate(study, effect, c, trials, nulls)
            for c in effect.coefficients
            if effect.in_base_model or c is effect.coefficients[0]
        ]
    if releases - {Release.DROP}:
        # The ratio of the masses and the rod change only a motion in which both masses take part
        has_both = bool(releases & {Release.LOOPING, Release.VERTICAL})
        known = {p: [e for t in study.trials if (e := study.estimate(p, t)) is not None] for p in APPARATUS}
        listed += [
            Candidate(
                name=f"{WRONG}{parameter}", parameter=parameter, role=ParameterRole.TIMES, null=1.0, bounds=FACTOR_BOUNDS,
                unit="", kind="wrong value", acts_on="apparatus", depends_on=(),
                formula=f"{parameter} -> factor * {parameter}", source=source, trials=trials,
                stated_error=max((e.sigma / abs(e.value) for e in known[parameter] if e.sigma), default=math.nan),
            )
            for parameter, source in APPARATUS.items()
            if known[parameter] and (parameter == "free_length" or has_both)
        ]  # fmt: skip
    listed += [
        Candidate(
            name=p.name, parameter=p.name, role=ParameterRole.CAMERA, null=p.null,
            bounds=(p.null - p.candidate_reach, p.null + p.candidate_reach), unit=p.unit, kind="measurement error",
            acts_on="camera", depends_on=(), formula=p.meaning, source="camera and its operator", trials=trials,
        )
        for p in map(CAMERA.__getitem__, camera)
        if p.candidate_reach
    ]  # fmt: skip
    return tuple(c for c in listed if (c.parameter, c.role) not in taken)


def in_words(name: str) -> str:
    """Return a candidate in plain words, with its name, by which files know it, in brackets.

    "a steady sideways force (side_force)", "a wrong value of the free length (wrong_free_length)"; of an effect that a study
    itself lists, the name alone.
    """
    parameter = name.removeprefix(WRONG)
    title = _TITLES.get(parameter, "")
    if title and parameter != name:
        title = f"a wrong value of {title}"
    return f"{title} ({name})" if title else name


_TITLES = MappingProxyType(
    {c.name: c.title for c in (*COEFFICIENTS.values(), *CAMERA.values()) if c.title}
    | {parameter: f"the {parameter.replace('_', ' ')}" for parameter in APPARATUS}
)
"""Parameter -> what it is, as part of a sentence."""


def _effect_candidate(
    study: Study, effect: Effect, c: Coefficient, trials: tuple[str, ...], nulls: dict[str, float]
) -> Candidate:
    """Return a coefficient of an effect as a candidate: an absent effect, or a wrong value of a declared one.

    Parameters
    ----------
    nulls
        Coefficient -> its value where its effect is absent [SI].
    """
    known = study.effects.get(c.name)
    declared = known is not None or effect.name == "gravity"
    null = known.value if known else (c.default if effect.name == "gravity" else c.null)
    role, bounds, bounds_reason = ParameterRole.SET, c.bounds, ""
    if c.name == "gravity":
        bounds = study.gravity_range
        where = "on Earth" if bounds == EARTH_GRAVITY else "where the trials were made"
        bounds_reason = f"gravity {where} is {bounds[0]:g} to {bounds[1]:g} m/s^2"
    if c.name == "static_friction" and known is None:  # it cannot be below the kinetic one, so it is fitted as a ratio to it
        role, null, bounds = ParameterRole.TIMES, 1.0, (1.0, 10.0)
    return Candidate(
        name=f"{WRONG}{c.name}" if declared else c.name, parameter=c.name, role=role, null=null, unit=c.unit,
        bounds=bounds, bounds_reason=bounds_reason, trials=trials, even=c.even,
        kind="wrong value" if declared else effect.kind.value, acts_on=effect.acts_on, depends_on=effect.depends_on,
        direction=effect.direction, formula=effect.formula, source=effect.source,
        multiplies="" if effect.in_base_model else multiplied_coefficient(effect, nulls),
        companions=() if effect.in_base_model else effect.coefficients[1:],
    )  # fmt: skip

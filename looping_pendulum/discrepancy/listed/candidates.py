"""What a declared model may lack or have wrong: every effect of the library, the apparatus's values, the camera's errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from looping_pendulum.discrepancy.data.measurement import CAMERA
from looping_pendulum.discrepancy.data.study import Study
from looping_pendulum.discrepancy.fit.problem import FreeParameter, ParameterRole
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient, Effect, EffectKind
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
GRID = 5
"""Starting values of a companion."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One number whose null value says that something is absent or right."""

    name: str
    parameter: str
    how: ParameterRole
    null: float
    """[SI]"""
    bounds: tuple[float, float]
    """Physically possible values [SI]."""
    unit: str
    kind: str
    acts_on: str
    depends_on: tuple[str, ...]
    formula: str
    source: str
    trials: tuple[str, ...]
    companions: tuple[Coefficient, ...] = ()
    """Coefficients that only shape what this one switches on; fitted with it."""

    @property
    def compiled(self) -> bool:
        """Whether the equations have terms only because of this."""
        return any(
            c.name == self.parameter for e in effect_library.EFFECTS.values() if not e.in_base_model for c in e.coefficients
        )

    def companion_grid(self) -> tuple[tuple[float, ...], ...]:
        """Values of the companions to start from: by half decades below the largest possible."""
        if not self.companions:
            return ((),)
        grids = [[c.bounds[1] * 10 ** (-0.5 * i) for i in range(1, GRID + 1)] for c in self.companions]
        return tuple(itertools.product(*grids))

    def companion_numbers(self, values: Sequence[float]) -> tuple[FreeParameter, ...]:
        """Return the companions as numbers of a fit that start at ``values`` [SI]."""
        return tuple(
            FreeParameter(
                name=c.name,
                parameter=c.name,
                how=ParameterRole.SET,
                trials=self.trials,
                start=v,
                scale=0.5 * v,
                prior=None,
                bounds=c.bounds,
            )
            for c, v in zip(self.companions, values, strict=True)
        )

    def number(self, scale: float, prior: float | None = None) -> FreeParameter:
        """Return it as a number of a fit, starting at its null value."""
        return FreeParameter(name=self.name, parameter=self.parameter, how=self.how, trials=self.trials, start=self.null, scale=scale,
                      prior=prior, bounds=self.bounds)  # fmt: skip


def candidates(study: Study, fitted: Iterable[FreeParameter], camera: Iterable[str]) -> tuple[Candidate, ...]:
    """Everything that could be added to a model.

    Parameters
    ----------
    fitted
        Numbers that the model has.
    camera
        Names of the camera's numbers that the trials depend on.
    """
    taken = {(n.parameter, n.how) for n in fitted}
    trials = tuple(t.name for t in study.trials)
    releases = {t.release for t in study.trials}
    found = []
    for effect in effect_library.EFFECTS.values():
        if effect.kind is EffectKind.CLOSURE or (effect.needs_string and releases == {Release.DROP}):
            continue
        found += [_of_library(study, effect, c, trials) for c in effect.coefficients if not _companion(effect, c)]
    if releases - {Release.DROP}:
        measured = {p for p in APPARATUS for t in study.trials if study.estimate(p, t) is not None}
        found += [_of_apparatus(p, trials) for p in APPARATUS if p in measured and _matters(p, releases)]
    found += [_of_camera(n, trials) for n in camera if not n.startswith("origin")]
    return tuple(c for c in found if (c.parameter, c.how) not in taken)


def _companion(effect: Effect, c: Coefficient) -> bool:
    """Whether a coefficient only shapes an effect that its first one switches on."""
    return not effect.in_base_model and effect.coefficients[0] is not c


def _matters(parameter: str, releases: set[Release]) -> bool:
    return parameter == "free_length" or bool(releases & {Release.LOOPING, Release.VERTICAL})


def _of_library(study: Study, effect: Effect, c: Coefficient, trials: tuple[str, ...]) -> Candidate:
    known = study.effects.get(c.name)
    declared = known is not None or effect.name == "gravity"
    null = known.value if known else (c.default if effect.name == "gravity" else c.null)
    how, bounds = ParameterRole.SET, c.bounds
    if c.name == "static_friction" and known is None:  # it cannot be below the kinetic one, so it is told as a ratio
        how, null, bounds = ParameterRole.TIMES, 1.0, (1.0, 10.0)
    return Candidate(
        name=f"wrong_{c.name}" if declared else c.name,
        parameter=c.name,
        how=how,
        null=null,
        bounds=bounds,
        unit=c.unit,
        kind="wrong value" if declared else effect.kind.value,
        acts_on=effect.acts_on,
        depends_on=effect.depends_on,
        formula=effect.formula,
        source=effect.source,
        trials=trials,
        companions=() if effect.in_base_model else effect.coefficients[1:],
    )


def _of_apparatus(parameter: str, trials: tuple[str, ...]) -> Candidate:
    return Candidate(
        name=f"wrong_{parameter}",
        parameter=parameter,
        how=ParameterRole.TIMES,
        null=1.0,
        bounds=FACTOR_BOUNDS,
        unit="",
        kind="wrong value",
        acts_on="apparatus",
        depends_on=(),
        formula=f"{parameter} -> factor * {parameter}",
        source=APPARATUS[parameter],
        trials=trials,
    )


def _of_camera(name: str, trials: tuple[str, ...]) -> Candidate:
    p = CAMERA[name]
    # one camera films all trials; farther off than this it would be a different study
    width = {"scale": 0.3, "tilt": math.radians(20), "clock_offset": 0.1, "clock_ratio": 0.3}[name]
    return Candidate(
        name=name,
        parameter=name,
        how=ParameterRole.CAMERA,
        null=p.null,
        bounds=(p.null - width, p.null + width),
        unit=p.unit,
        kind="measurement error",
        acts_on="camera",
        depends_on=(),
        formula=p.meaning,
        source="camera and its operator",
        trials=trials,
    )

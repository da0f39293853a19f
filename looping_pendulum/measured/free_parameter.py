"""The parameters that a fit changes: where they act, their measured values and errors, and their bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

WEAK_PRIOR_SIGMA = 10.0
"""Standard error of the prior of a parameter that was not measured, in units of its scale.

It keeps the parameter within reason in early windows. An added effect has a far wider one (`evidence.explanation.WIDE`), so
that the data alone say how large it is.
"""


class ParameterRole(StrEnum):
    """How a free parameter enters the parameter of the model that it is named after.

    The values are words for the report.
    """

    SET = "is"
    """It replaces the model's value."""
    TIMES = "multiplies"
    """It is a factor on the model's value."""
    CAMERA = "is, of the camera,"
    """It replaces a value of the trial's camera."""


@dataclass(frozen=True, kw_only=True)
class FreeParameter:
    """One parameter that a fit changes, as lmfit's ``Parameter`` with ``vary=True``."""

    name: str
    """Name in the fit, with that of the trial in front if it is not shared: "first.release_angle"."""
    parameter: str
    """Parameter of the model or camera that it changes."""
    role: ParameterRole = ParameterRole.SET
    """How it enters that parameter."""
    trials: tuple[str, ...]
    """Names of the trials in which it acts."""
    init_value: float
    """Initial value [SI]: the measured one if there is one."""
    scale: float
    """Change of the value per unit of x [SI]: the standard error if the value was measured."""
    prior: float | None = None
    """Standard error of the prior, in units of `scale`; None: not measured, the prior has `WEAK_PRIOR_SIGMA`."""
    bounds: tuple[float, float] = (-math.inf, math.inf)
    """Smallest and largest value [SI]."""

    @property
    def shared(self) -> bool:
        """Return whether it acts in all trials alike, not in a single one."""
        return "." not in self.name

    @property
    def limits(self) -> tuple[float, float]:
        """Return the bounds of x."""
        low, high = ((b - self.init_value) / self.scale for b in self.bounds)
        return low, high

    @property
    def sigma(self) -> float | None:
        """Return the standard error of the measured value [SI]; None: nothing was measured."""
        return self.scale if self.prior == 1.0 else None

    @property
    def prior_sigma(self) -> float:
        """Return the standard error of the prior in units of `scale`, that of a parameter without a measured value included."""
        return self.prior or WEAK_PRIOR_SIGMA

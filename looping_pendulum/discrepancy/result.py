"""The result of an identification as plain data: the report, the figures and verdict.json are made of this one object.

SI and radians throughout, unless a unit is given. verdict.json has ``schema`` {id, version}, then the fields of
`Identification` by their names, as documented there; null for what is not known or not finite. Fields marked `compare=False`
(arrays for figures) are left out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.compare import json_text
from looping_pendulum.discrepancy.candidates import in_words
from looping_pendulum.discrepancy.fit.residual import ModelTest
from looping_pendulum.errors import ResultError
from looping_pendulum.pages.numbers import amount, quantity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote

if TYPE_CHECKING:
    from looping_pendulum.discrepancy.first_look.check import DeclarationCheck

SCHEMA_ID = "looping-pendulum/identification"
SCHEMA_VERSION = 10


@dataclass(frozen=True, kw_only=True)
class TrialError:
    """How far the declared and the repaired model are from one trial."""

    trial: str
    held_out: bool
    rms_before: float | None
    """RMS residual of the calibrated declared model [unit]: of the light mass's position where it was tracked, else of all
    channels; None: the trial has only events."""
    rms_after: float | None
    """The same of the repaired model [unit]."""
    standardised_rms_before: float
    """RMS residual of the calibrated declared model in units of the noise; 1 is the best possible."""
    standardised_rms_after: float
    """The same of the repaired model."""
    events_before: Mapping[str, float]
    """SI unit -> RMS of measured less predicted events of that unit, by the calibrated declared model."""
    events_after: Mapping[str, float]
    """The same by the repaired model."""
    unit: str = "m"
    """SI unit of the RMS residuals; empty: channels of several units together."""


@dataclass(frozen=True, kw_only=True)
class Outliers:
    """Tracked points of one body in one trial that do not show it, and so were left out of all fits and tests."""

    trial: str
    held_out: bool
    channels: tuple[str, ...]
    """Channels of the body."""
    count: int
    of: int
    """Number of tracked points of the body, outliers included."""
    intervals: tuple[tuple[float, float], ...]
    """First and last time of each run of neighbouring outliers, by the file's clock [s]."""
    largest_distance: float
    """Largest distance of an outlier from the repaired model [unit]."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class EventResidual:
    """One measured event beside the predictions of both models."""

    trial: str
    held_out: bool
    quantity: str
    index: int
    unit: str
    measured: float
    """Measured value [unit]."""
    sigma: float
    """Standard error [unit]."""
    before: float | None
    """Prediction of the calibrated declared model [unit]; None: the event does not happen in its run."""
    after: float | None
    """The same of the repaired model."""


@dataclass(frozen=True, kw_only=True)
class RecordStart:
    """Start of the motion in a record that begins in mid-swing, at its first tracked point, by the repaired model."""

    trial: str
    held_out: bool
    time: float
    """Time of the first tracked point by the file's clock [s]."""
    angle: float
    """Wrap angle there [rad]; pi: straight down."""
    angle_error: float
    """Standard error [rad]; 0: stated as exact."""
    speed: float
    """Speed of the light mass across its string there [m/s], positive as the wrap angle grows."""
    speed_error: float
    """Standard error [m/s]; 0: stated as exact."""


@dataclass(frozen=True, kw_only=True)
class CorrelatedError:
    """Errors of one body's tracked points that last longer than a frame, as of a tracker that wanders over its mark."""

    body: str
    """Body, of `observations.BODIES`."""
    amplitude: float
    """Standard deviation of these errors, each coordinate [unit]."""
    unit: str
    """SI unit of `amplitude`."""
    correlation_time: float
    """Time in which they change [s]."""
    points: float
    """The same in tracked points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialFigure:
    """Arrays of one trial for the figures: channel -> values; residuals in units of noise."""

    trial: str
    held_out: bool
    channels: tuple[str, ...]
    t: Mapping[str, Array]
    measured: Mapping[str, Array]
    before: Mapping[str, Array]
    after: Mapping[str, Array]
    residual_before: Mapping[str, Array]
    """NaN for outliers."""
    residual_after: Mapping[str, Array]
    outliers: Mapping[str, NDArray[np.bool_]]
    """Which values were left out as outliers."""


class Verdict(StrEnum):
    """What the data say about the declared model."""

    NO_MISSING_EFFECT = "no_missing_effect"
    """The declared model explains the data to their noise."""
    IDENTIFIED = "identified"
    """One explanation by listed effects has 95 % of the probability."""
    AMBIGUOUS = "ambiguous"
    """It takes several explanations to have 95 % of the probability."""
    UNLISTED = "unlisted"
    """Only with an unknown force as a function of one coordinate is a model probable."""
    UNEXPLAINED = "unexplained"
    """The most probable explanation fails a test: its fit has not converged, its residuals do not look like noise, or held-out
    data are predicted neither to their noise nor better than by the declared model."""
    INTERRUPTED = "interrupted"
    """The search was ended by Ctrl-C or by its time limit."""


NORMAL_95 = 1.96
"""Standard errors that contain 95 % of a normal distribution, on either side."""


@dataclass(frozen=True, kw_only=True)
class IdentifiedEffect:
    """One effect that the declared model lacks or has wrong, with its fitted value."""

    name: str
    kind: str
    acts_on: str
    depends_on: tuple[str, ...]
    formula: str
    source: str
    parameter: str
    meaning: str
    """How the value enters: it "is" the parameter, or "multiplies" it."""
    value: float
    """Fitted value [unit]."""
    error: float
    """Standard error [unit]."""
    interval: tuple[float | None, float | None] | None
    """Where the value lies with 95 % probability [unit]; an end that is None: the data set no limit on that side.

    By its profile likelihood where the model is far from linear in the value, and with an end farther towards the null value
    where the effect is just large enough to be named (`likelihood.stated_interval`). None in its place: 1.96 standard errors on
    either side.
    """
    null_value: float
    """Value at which the effect is absent [unit]."""
    unit: str
    companions: tuple[tuple[str, float, float], ...]
    """Further coefficients that were fitted with the effect: name, value, standard error [SI]."""
    direction: str = ""
    """Axis along which its force acts, "x" or "y"; empty: no fixed one."""

    @property
    def interval_95(self) -> tuple[float | None, float | None]:
        """Return where the value lies with 95 % probability [unit]; None: the data set no limit on that side."""
        reach = NORMAL_95 * self.error
        return self.interval or (self.value - reach, self.value + reach)


STRING_ON_ROD = "string on rod"
"""What a law of the string acts on (`UnlistedLaw.acts_on`)."""


@dataclass(frozen=True, kw_only=True)
class UnlistedLaw:
    """What a law that no library lists acts on and depends on."""

    acts_on: str
    depends_on: str
    multiplied_by: str = "constant"
    """Factor of the force beside the function of the coordinate: "constant", or a speed."""

    @property
    def in_words(self) -> str:
        """What it is, as part of a sentence."""
        is_friction = self.acts_on == STRING_ON_ROD
        law = "change of the friction of the string on the rod" if is_friction else f"force on the {self.acts_on}"
        factor = self.multiplied_by.replace("_", " ")
        factor = "" if factor == "constant" else f" in proportion to the {factor}, and"
        return f"{law}{factor} as a function of the {self.depends_on.replace('_', ' ')}"


@dataclass(frozen=True, kw_only=True)
class RankedExplanation:
    """What may be missing, beside others: listed effects, a law that no library lists, or both."""

    effects: tuple[IdentifiedEffect, ...]
    """Listed effects; empty without a law: nothing is missing."""
    law: UnlistedLaw | None
    probability: float | None
    """None: it adds nothing that shows to another explanation, which is a part of it and with which it is counted."""
    log10_odds: float
    """Decimal logarithm of how much more probable it is than that nothing is missing."""
    credible: bool
    """Whether it is in the smallest set of explanations that has 95 % of the probability, or tied with one that is."""
    checked: bool = False
    """Whether its probability is by importance sampling, and not by a Gaussian about the best fit."""
    held_out_error: float | None = None
    """Its RMS error in the worst held-out trial, or in all blocks of time [noise]; None: it was not fitted without these."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parts."""
        return (*(e.name for e in self.effects), *((f"unlisted {self.law.in_words}",) if self.law else ()))

    @property
    def in_words(self) -> str:
        """Its parts in plain words; "nothing" without any."""
        law = [f"an unlisted {self.law.in_words}"] if self.law else []
        return " and ".join([*(in_words(e.name) for e in self.effects), *law]) or "nothing"


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """Value and standard error of a `FreeParameter` after a fit, beside what was known of it before."""

    name: str
    value: float
    """Fitted value [SI]."""
    error: float
    """Standard error [SI]."""
    measured: float
    """Measured value, or the initial value where nothing was measured [SI]: `FreeParameter.init_value`."""
    measured_error: float | None
    """Standard error of the measured value [SI], `FreeParameter.sigma`; None: nothing was measured."""
    at_bound: bool


@dataclass(frozen=True, kw_only=True)
class FitReport:
    """Parameters and diagnostics of a fit."""

    parameters: tuple[FittedParameter, ...]
    correlations: tuple[tuple[str, str, float], ...]
    """Pairs of parameters whose correlation exceeds 0.9 in size: two names, and the correlation."""
    condition_number: float
    """Condition number of the scaled Jacobian."""
    chi2_per_dof: float
    """Chi-square per degree of freedom (reduced chi-square)."""
    held_out_chi2: float
    """Largest chi2 per value on held-out data."""
    failed_tests: tuple[str, ...]
    """What the tests that the model fails say, in words; empty: the model explains the data to their noise."""
    start_costs: tuple[float, ...]
    """Cost (sum of squared standardised residuals) at which the fit from each start ended."""
    tests: tuple[ModelTest, ...] = ()
    """Every test of the model, with its value and limit."""


MIN_SEPARATION = 3.0
"""Distance of two explanations' predictions [units of noise] up to which a trial does not tell them apart."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A trial that would separate tied explanations."""

    release: str
    release_angle: float
    """Angle of release [rad]."""
    mass_ratio: float | None
    """Heavy over light mass, M2/M1; None: the heavy mass is held."""
    free_length: float
    """Free length at release [m]."""
    pairs: int
    """Number of pairs of tied explanations."""
    separated_pairs: int
    """How many of these the trial separates by more than `MIN_SEPARATION`."""
    distance: float
    """Expected distance of the closest two of these [units of noise], all else fitted to the new trial; if none, of any two."""
    tells_apart: tuple[str, str]
    """Those two explanations."""


@dataclass(frozen=True, kw_only=True)
class ForceProfile:
    """An unknown force in one direction, as a function of one coordinate."""

    side: str
    """"along" the light mass's string towards the rod, "across" it, or on the "heavy" mass upward."""
    coordinate: tuple[float, ...]
    """Coordinates of the points of the profile [`Unlisted.unit`]."""
    value: tuple[float, ...]
    """Force at each point, as radial basis functions [N], or [N s/m] if multiplied by a speed."""
    error: tuple[float, ...]
    """Standard error of each value."""
    largest: float
    """Value of largest size of the formula, or of the radial basis functions where no formula is accepted."""
    largest_at: float
    """Coordinate of the largest value."""
    significant_from: float | None
    """Smallest coordinate at which the force exceeds two standard errors; None: nowhere."""
    significant_to: float | None
    """Largest coordinate at which the force exceeds two standard errors; None: nowhere."""
    formula: str
    """Force in this direction in the repaired model: the refitted formula, or words for the radial basis functions where no
    formula is accepted; s is the coordinate, u and w the light mass's speeds."""
    fitted_formula_values: tuple[float, ...] | None
    """Values of the refitted formula along the coordinate; None: no formula is accepted."""


def value_unit(acts_on: str, multiplied_by: str) -> str:
    """Return the unit of an unknown law's profile; '' for a change of the friction coefficient."""
    if acts_on == STRING_ON_ROD:
        return ""
    return "N" if multiplied_by == "constant" else "N s/m"


@dataclass(frozen=True, kw_only=True)
class FormulaParameter:
    """One parameter of a formula, fitted to the trajectories together with all parameters of the declared model."""

    name: str
    """"place", "width", or the side and what the parameter is there: "across_height"."""
    value: float
    """Fitted value [unit]."""
    error: float
    """Standard error [unit]."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class Formula:
    """A formula of the unknown force, refitted by trajectory."""

    form: str
    depends_on: str
    multiplied_by: str
    parameters: tuple[FormulaParameter, ...]
    delta_bic: float
    """Decrease of the Bayesian information criterion from the declared model to the formula."""
    delta_bic_of_profile: float
    """The same of the radial basis functions that the formula was fitted to, by their effective number of parameters."""
    held_out_chi2: float | None
    """Largest chi2 per value on held-out data; None: not judged, since a better formula was accepted or its delta BIC is too
    far behind."""
    held_out_chi2_of_profile: float
    """The same of the radial basis functions that the formula was fitted to."""
    accepted: bool
    """Whether the formula has a larger delta BIC than its radial basis functions, and explains held-out data as well as the
    best of all radial basis functions do."""


@dataclass(frozen=True, kw_only=True)
class Unlisted(UnlistedLaw):
    """An unknown force, which no effect of the library is."""

    unit: str
    """Unit of the coordinate."""
    profiles: tuple[ForceProfile, ...]
    """The force in each direction in which it acts."""
    formula: Formula | None
    """Formula in the repaired model; None: no simple formula explains held-out data as well as the radial basis functions."""
    formulas: tuple[Formula, ...]
    """Every formula that was refitted, the best first."""
    phase: str
    """Phase of the motion in which most of the force acts."""
    log_bayes_factor: float
    """Natural logarithm of the factor by which it makes the data more probable."""
    held_out_chi2_before: float
    """Largest chi2 per value on held-out data of the declared model."""
    held_out_chi2_after: float
    """The same of the repaired model."""
    point: tuple[float, float] | None = None
    """Point (x, y) from which the coordinate "distance" is measured [m]; None for other coordinates."""

    @property
    def value_unit(self) -> str:
        """Unit of the profiles; '' for a change of the friction coefficient."""
        return value_unit(self.acts_on, self.multiplied_by)

    @property
    def in_words(self) -> str:
        """What it is and what it depends on, as part of a sentence."""
        place = "" if self.point is None else f" from x = {self.point[0]:.3f} m, y = {self.point[1]:.3f} m"
        return f"{super().in_words}{place}"


@dataclass(frozen=True, kw_only=True)
class SmallestVisible:
    """The smallest size of a candidate that these data would show."""

    name: str
    value: float
    """Change of the value [unit] that is four standard errors large (`evidence.prior.VISIBLE`)."""
    unit: str
    acts_on: str
    null_value: float
    """Value at which the effect is absent [unit]; 1 for a factor."""
    motion: float
    """RMS change of the predictions by this change, all else unchanged [units of noise]: what the fitted parameters hide."""
    can_hide: bool = field(default=False, compare=False)
    """Whether it changes nothing, however large it is, at the fit or with some of its companions' initial values."""

    @property
    def in_words(self) -> str:
        """The value with its unit; of a factor, as a percentage."""
        return f"{amount(self.value, 100)} %" if not self.unit and self.null_value == 1 else quantity(self.value, self.unit)


@dataclass(frozen=True, kw_only=True)
class Identification:
    """Everything that an identification yields."""

    study: str
    title: str
    seed: int
    verdict: Verdict
    sentence: str
    """The verdict in one sentence."""
    notes: tuple[str, ...] = ()
    """Further sentences: what was ruled out, what nearly shows, errors of the tracked points, outliers."""
    effects: tuple[IdentifiedEffect, ...]
    """Effects that were added to the model: those of the most probable explanation; none if it is not said to explain."""
    explanations: tuple[RankedExplanation, ...]
    """The most probable of all that were fitted, in their order, the best of each kind, and that nothing is missing."""
    explanations_fitted: int
    """Number of explanations that were fitted."""
    unlisted: Unlisted | None
    """The unknown force of the most probable explanation that has one, if that is credible."""
    correlated_noise: tuple[CorrelatedError, ...]
    """Errors of the tracked points that last longer than a frame, under the model of `after`; empty: they are white noise."""
    smallest_visible: tuple[SmallestVisible, ...]
    """For each candidate that was not added, the smallest size that these data would show beside the repaired model."""
    can_hide: tuple[str, ...] = ()
    """Candidates without such a size: what is fitted with them can keep them from acting, as friction holds a rod's bearing, or
    where they multiply a drag of zero."""
    next_experiments: tuple[Experiment, ...]
    """Trials that would separate tied explanations, the best first."""
    errors: tuple[TrialError, ...]
    events: tuple[EventResidual, ...]
    """Every row of every event table."""
    outliers: tuple[Outliers, ...]
    """For each trial and body that has some, the tracked points that were left out as outliers."""
    record_starts: tuple[RecordStart, ...] = ()
    """For each trial whose record begins in mid-swing, how its motion begins."""
    before: FitReport
    """Fit of the declared model."""
    after: FitReport
    """Fit of the most probable model: the repaired one or, if the verdict is `unexplained`, the nearest."""
    judged_on: str
    """Kind of held-out data: "held-out trials" or "held-out blocks of time"."""
    data: tuple[str, ...]
    """For each trial, how many values were used, and which were not and why."""
    provenance: Mapping[str, str]
    """Package -> version."""
    scenario: str = field(compare=False)
    """The repaired model of the first trial as a scenario file."""
    trial_figures: tuple[TrialFigure, ...] = field(default=(), compare=False)
    """Arrays for the figure of each trial that was tracked."""
    first_look: DeclarationCheck | None = field(default=None, compare=False)
    """Comparison of the points with the declaration before any fit; what looked wrong there is among the notes."""

    @property
    def has_other_model(self) -> bool:
        """Whether the model of `after` differs from the declared one."""
        return bool(self.explanations[0].names)

    @property
    def other_model(self) -> str:
        """What that model is called."""
        return "nearest model" if self.verdict is Verdict.UNEXPLAINED else "repaired model"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the added effects."""
        return tuple(e.name for e in self.effects)

    @property
    def credible(self) -> tuple[RankedExplanation, ...]:
        """The smallest set of explanations that has 95 % of the probability, the most probable first."""
        return tuple(e for e in self.explanations if e.credible)

    @property
    def ties(self) -> tuple[tuple[IdentifiedEffect, ...], ...]:
        """Effects of every explanation by listed ones that these data cannot tell from the best; empty unless ambiguous."""
        if self.verdict is not Verdict.AMBIGUOUS:
            return ()
        return tuple(e.effects for e in self.credible if e.effects and not e.law)


def dump(result: Identification) -> str:
    """Write a result as JSON text."""
    return json_text.dump(result, SCHEMA_ID, SCHEMA_VERSION)


def load(text: str) -> dict[str, Any]:
    """Read the text of a verdict.json as plain data, under the field names of its `Identification`.

    Raises
    ------
    ResultError
        If the text is no JSON, is no verdict.json, or is of another version.
    """
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ResultError(f"verdict.json: {error}; write it again with `looping-pendulum identify`") from None
    schema = tree.pop("schema", None) if isinstance(tree, dict) else None
    if not isinstance(schema, dict) or schema.get("id") != SCHEMA_ID:
        raise ResultError(f"verdict.json: schema: found {quote(schema)}, needed the id {SCHEMA_ID!r}")
    if schema.get("version") != SCHEMA_VERSION:
        problem = f"found version {quote(schema.get('version'))}, needed {SCHEMA_VERSION}"
        raise ResultError(f"verdict.json: schema: {problem}; write it again with `looping-pendulum identify`")
    return cast(dict[str, Any], tree)

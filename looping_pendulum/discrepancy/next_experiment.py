"""Find the trial, within the experimenter's limits, that would best tell tied explanations apart."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import free_parameters_of
from looping_pendulum.discrepancy.fit.residual import problem_of_trial
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.observations import Channel, DataError, Observations
from looping_pendulum.measured.study import Estimate, Study, Trial
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release

MIN_SEPARATION = 3.0
"""Distance of two explanations' predictions [units of noise] up to which a trial does not tell them apart."""
ANGLE_COUNT = 5
"""Release angles that are tried between the limits."""
RATIO_COUNT = 3
"""Mass ratios that are tried between the limits."""
MAX_EXPERIMENTS = 3
"""Trials that are proposed."""
# The camera of a proposed trial has the frame rate and the noise of the data that the search was tested on
FRAME_RATE = 240.0
"""Frame rate of a proposed trial [Hz]."""
DURATION = 1.0
"""Duration of a proposed trial [s]."""
HELD_FRAME_RATE, HELD_DURATION = 30.0, 30.0
"""Frame rate [Hz] and duration [s] of a proposed trial of a held pendulum: losses show in its decay."""
LENGTH_FACTORS = (1.0, 0.5, 2.0)
"""Free lengths of a held pendulum that are tried, relative to that of the first trial."""
HELD_ANGLES, HELD_ANGLE_COUNT = (math.radians(130), math.radians(170)), 3
"""Smallest and largest release angle of a held pendulum without limits [rad], and the number that is tried between them."""
NOISE, LENGTH_ERROR, ANGLE_ERROR = 1e-3, 1e-3, math.radians(0.5)
"""Standard errors of a coordinate in a proposed trial [m], and of its length [m] and angle [rad] where none is stated."""
TRIAL_NAME = "next"
"""Name of a proposed trial in the problems that are built of it."""


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


def best_experiments(study: Study, fits: Sequence[Fit], names: Sequence[tuple[str, ...]]) -> tuple[Experiment, ...]:
    """Rank possible trials by how many pairs of explanations they separate, then by how well, after a refit of all else.

    Parameters
    ----------
    fits
        Tied explanations, the best first.
    names
        Names of the effects that each explanation adds to the declared model.
    """
    rated = [e for e in (_rate(study, fits, names, trial) for trial in _trials(study)) if e]
    return tuple(sorted(rated, key=lambda e: (-e.separated_pairs, -e.distance))[:MAX_EXPERIMENTS])


def _rate(study: Study, fits: Sequence[Fit], names: Sequence[tuple[str, ...]], trial: Trial) -> Experiment | None:
    """Return a possible trial with what it separates; None: one of the explanations cannot run it."""
    try:
        predictions = [_predict(study, trial, fit) for fit in fits]
        pairs = [(_distance(a, b), (i, j)) for (i, a), (j, b) in itertools.combinations(enumerate(predictions), 2)]
    except (HarnessError, ValueError, np.linalg.LinAlgError):
        return None
    separated = [pair for pair in pairs if pair[0] > MIN_SEPARATION]
    distance, (i, j) = min(separated or pairs)
    p = study.parameters({}, trial)
    return Experiment(
        release=trial.release.value,
        release_angle=p.release_angle,
        mass_ratio=None if trial.release is Release.HELD else p.heavy_mass / p.light_mass,
        free_length=p.free_length,
        pairs=len(pairs),
        separated_pairs=len(separated),
        distance=distance,
        tells_apart=("+".join(names[i]), "+".join(names[j])),
    )


def _trials(study: Study) -> Iterator[Trial]:
    """Yield possible trials: the apparatus of the first training trial, with another release, heavy mass or string."""
    template = next((t for t in study.training if t.release is Release.LOOPING), None)
    light = study.estimate("light_mass", template) if template else None
    if template is None or light is None:
        yield from _held_trials(study)
        return
    angles = np.linspace(*(study.limits.release_angle or (math.radians(60), math.radians(130))), ANGLE_COUNT).tolist()
    ratios = np.geomspace(*(study.limits.mass_ratio or (4.0, 10.0)), RATIO_COUNT).tolist()
    known_heavy = study.estimate("heavy_mass", template)
    # Half a percent where no error is stated
    error = known_heavy.sigma / known_heavy.value if known_heavy and known_heavy.sigma else 0.005
    known_angle, length = template.estimates.get("release_angle"), study.estimate("free_length", template)
    for release, ratio, angle in itertools.product(study.limits.releases, ratios, angles):
        # A drop has no string, a held mass does not matter, and of a vertical release, without an angle, one turn is enough
        is_repeated = (release is Release.HELD and ratio != ratios[0]) or (release is Release.VERTICAL and angle != angles[0])
        if release is Release.DROP or is_repeated:
            continue
        own = {name: e for name, e in template.estimates.items() if name != "release_angle"}
        own["heavy_mass"] = Estimate(value=ratio * light.value, sigma=error * ratio * light.value)
        if release is not Release.VERTICAL:
            own["release_angle"] = Estimate(value=angle, sigma=(known_angle and known_angle.sigma) or ANGLE_ERROR)
        elif length is not None:
            own["free_length"] = Estimate(value=length.value, sigma=length.sigma or LENGTH_ERROR)
        yield dataclasses.replace(template, name=TRIAL_NAME, release=release, estimates=own, held_out=False)


def _held_trials(study: Study) -> Iterator[Trial]:
    """Yield possible trials of a study that has held pendulums: the first of them on other lengths, let go at rest."""
    template = next((t for t in study.training if t.release is Release.HELD), None)
    length = study.estimate("free_length", template) if template else None
    if template is None or length is None or Release.HELD not in study.limits.releases:
        return
    angles = np.linspace(*(study.limits.release_angle or HELD_ANGLES), HELD_ANGLE_COUNT).tolist()
    for factor, angle in itertools.product(LENGTH_FACTORS, angles):
        own = {n: e for n, e in template.estimates.items() if n != "push_across"}
        own["free_length"] = Estimate(value=factor * length.value, sigma=length.sigma or LENGTH_ERROR)
        own["release_angle"] = Estimate(value=angle, sigma=ANGLE_ERROR)
        yield dataclasses.replace(
            template, name=TRIAL_NAME, estimates=own, camera={}, held_out=False, mirrored=False, in_mid_swing=False
        )


class _Prediction(NamedTuple):
    """What one explanation predicts of a possible trial."""

    values: Array
    """Predicted values, in units of the noise, shape (n,)."""
    jacobian: Array
    """Their derivatives by the free parameters of the trial's problem, then the rows of the prior, shape (n + p, p)."""


def _predict(study: Study, trial: Trial, fit: Fit) -> _Prediction:
    """Predict a possible trial by one explanation; what its fit knows replaces the priors of what they share."""
    extended = dataclasses.replace(study, trials=(*study.trials, trial))
    held = trial.release is Release.HELD
    duration, frame_rate = (HELD_DURATION, HELD_FRAME_RATE) if held else (DURATION, FRAME_RATE)
    t = np.arange(1, int(duration * frame_rate)) / frame_rate
    names = ("light_x", "light_y") if held else ("light_x", "light_y", "heavy_x", "heavy_y")
    channels = tuple(Channel(name=n, t=t, value=np.zeros(len(t))) for n in names)
    own = free_parameters_of(extended, [(trial, Observations(name=TRIAL_NAME, file=TRIAL_NAME, channels=channels))])
    added = [dataclasses.replace(n, trials=(*n.trials, TRIAL_NAME)) for n in fit.problem.free_parameters if n.shared]
    data = TrialData(trial=trial, channels=channels, sigma=np.full(len(names) * len(t), NOISE))
    problem = problem_of_trial(fit, extended, data, own, added)
    values = problem.predict(problem.prior_mean, 0) / data.sigma
    if not np.all(np.isfinite(values)):
        raise DataError("the predictions are not finite")
    return _Prediction(values, problem.jacobian(problem.prior_mean))


def _distance(first: _Prediction, second: _Prediction) -> float:
    """Return the Mahalanobis distance of two predictions; what a refit to the new trial would change is uncertainty."""
    difference = first.values - second.values
    # d' (I + J C J')^-1 d by the Woodbury identity, which inverts a matrix of the size of the parameters, not of the data
    projected = first.jacobian[: len(difference)].T @ difference
    square = float(difference @ difference - projected @ np.linalg.solve(first.jacobian.T @ first.jacobian, projected))
    # Rounding can leave the square of a small distance slightly negative
    return math.sqrt(max(square, 0.0))

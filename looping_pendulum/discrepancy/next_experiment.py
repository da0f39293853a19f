"""The trial, within the experimenter's limits, that would best tell tied explanations apart."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from looping_pendulum.discrepancy.data.observations import Channel, DataError, Observations
from looping_pendulum.discrepancy.data.study import Estimate, Study, Trial
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import FreeParameter, Problem, TrialData, free_parameters_of
from looping_pendulum.discrepancy.result import Experiment
from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release

ANGLES, RATIOS = 5, 3
"""How many values of each are tried between the limits."""
LISTED = 3
FRAME_RATE, DURATION, NOISE = 240.0, 1.0, 1e-3
"""Of the imagined trial [Hz, s, m], where the study's own trials do not say."""
NAME = "next"


def best_experiments(study: Study, fits: Sequence[Fit], names: Sequence[tuple[str, ...]]) -> tuple[Experiment, ...]:
    """Rank imagined trials by the distance between the first two explanations, in units of noise, after refitting all else.

    Parameters
    ----------
    fits
        Tied explanations, the best first.
    names
        What each has that the declared model has not.
    """
    found = []
    for trial in _trials(study, fits[0]):
        try:
            pairs = [(_distance(study, trial, a, b), (i, j)) for (i, a), (j, b) in itertools.combinations(enumerate(fits), 2)]
        except (HarnessError, ValueError, np.linalg.LinAlgError):
            continue
        distance, (i, j) = min(pairs)
        masses = [known.value for p in ("heavy_mass", "light_mass") if (known := study.estimate(p, trial)) is not None]
        found.append(
            Experiment(
                release=trial.release.value,
                release_angle=trial.own["release_angle"].value if "release_angle" in trial.own else math.pi,
                mass_ratio=masses[0] / masses[-1],
                distance=distance,
                tells_apart=("+".join(names[i]), "+".join(names[j])),
            )
        )
    return tuple(sorted(found, key=lambda e: -e.distance)[:LISTED])


def _trials(study: Study, fit: Fit) -> Iterator[Trial]:
    """Imagined trials: the first one's apparatus, with another release or heavy mass."""
    like = next((t for t in study.training if t.release is Release.LOOPING), None)
    light = study.estimate("light_mass", like) if like else None
    if like is None or light is None:
        return
    angles = np.linspace(*(study.limits.release_angle or (math.radians(60), math.radians(130))), ANGLES)
    ratios = np.geomspace(*(study.limits.mass_ratio or (4.0, 10.0)), RATIOS)
    for release, ratio in itertools.product(study.limits.releases, ratios):
        if release is Release.DROP or (release is Release.HELD and ratio != ratios[0]):
            continue
        for angle in angles if release is not Release.VERTICAL else angles[:1]:
            own = dict(like.own)
            heavy = like.own.get("heavy_mass") or study.apparatus.get("heavy_mass")
            own["heavy_mass"] = Estimate(value=float(ratio) * light.value, sigma=_relative(heavy) * float(ratio) * light.value)
            angle_known = own.pop("release_angle", None) or Estimate(value=0.0, sigma=math.radians(1))
            if release is not Release.VERTICAL:
                own["release_angle"] = Estimate(value=float(angle), sigma=angle_known.sigma or math.radians(0.5))
            else:
                length = study.estimate("free_length", like)
                assert length is not None
                own["free_length"] = Estimate(value=length.value, sigma=length.sigma or 1e-3)
            yield dataclasses.replace(like, name=NAME, release=release, own=own, held_out=False)


def _relative(known: Estimate | None) -> float:
    return known.sigma / known.value if known and known.sigma else 0.005


def _distance(study: Study, trial: Trial, one: Fit, other: Fit) -> float:
    """Mahalanobis distance of the two predictions; what either would refit to the new trial counts as uncertainty."""
    wider = dataclasses.replace(study, trials=(*study.trials, trial))
    t = np.arange(1, int(DURATION * FRAME_RATE)) / FRAME_RATE
    channels = tuple(Channel(name=n, t=t, value=np.zeros(len(t))) for n in ("light_x", "light_y", "heavy_x", "heavy_y"))
    observations = Observations(name=NAME, file=NAME, channels=channels)
    data = TrialData(trial=trial, channels=channels, sigma=np.full(4 * len(t), NOISE))
    own = free_parameters_of(wider, [(trial, observations)])
    problem, x, covariance = _placed(wider, data, own, one)
    predicted = problem.predict(x, 0)
    rival, y, _ = _placed(wider, data, own, other)
    apart = (predicted - rival.predict(y, 0)) / data.sigma
    if not np.all(np.isfinite(apart)):
        raise DataError("the rival predictions are not finite")
    jacobian = problem.jacobian(x)[: len(apart)]
    # (I + J C J')^-1 by Woodbury
    inner = np.linalg.pinv(covariance, hermitian=True) + jacobian.T @ jacobian
    projected = jacobian.T @ apart
    square = float(apart @ apart - projected @ np.linalg.solve(inner, projected))
    return math.sqrt(max(square, 0.0))


def _placed(study: Study, data: TrialData, own: Sequence[FreeParameter], fit: Fit) -> tuple[Problem, Array, Array]:
    """Problem of the imagined trial under one explanation, with what its fit says of each number and how surely."""
    known = {n.name: i for i, n in enumerate(fit.problem.numbers)}
    library = {n.name for n in own}
    added = [
        dataclasses.replace(n, trials=(*n.trials, NAME))
        for n in fit.problem.numbers
        if "." not in n.name and n.name not in library
    ]
    numbers = [*own, *added]
    x = np.zeros(len(numbers))
    covariance = np.diag([(n.prior or 10.0) ** 2 for n in numbers])
    here = [i for i, n in enumerate(numbers) if n.name in known]
    there = [known[numbers[i].name] for i in here]
    x[here] = fit.x[there]
    covariance[np.ix_(here, here)] = fit.covariance[np.ix_(there, there)]
    return Problem(study, [data], numbers), x, covariance

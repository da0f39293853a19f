"""Read all files of a study and make their data ready to be fitted."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from looping_pendulum.discrepancy.candidates import Candidate, candidates
from looping_pendulum.discrepancy.fit.data import TrialData, trial_data
from looping_pendulum.discrepancy.fit.event_prediction import check_event_rows
from looping_pendulum.discrepancy.fit.problem import Problem, free_parameters_of
from looping_pendulum.measured.edits import read_trial, until_end, with_ball, with_free_start
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.observations import DataError, Observations
from looping_pendulum.measured.study import Study, Trial, refuse_seen_points


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """All data of a study, its free parameters, and the candidates that could be added to its model."""

    study: Study
    observed: tuple[tuple[Trial, Observations], ...]
    """Every trial with its usable observations."""
    training: tuple[TrialData, ...]
    """Data of the trials that are fitted."""
    free_parameters: tuple[FreeParameter, ...]
    """Parameters of the declared model that a fit of the training trials may change."""
    held_out: tuple[tuple[TrialData, tuple[FreeParameter, ...]], ...]
    """Data of each held-out trial, with the free parameters of that trial."""
    library: tuple[Candidate, ...]
    """Everything that could be added to the declared model."""

    def problem(self) -> Problem:
        """Return the fit of the declared model to all trials, held-out ones included."""
        data = [*self.training, *(d for d, _ in self.held_out)]
        return Problem(self.study, data, free_parameters_of(self.study, self.observed))


def read_inputs(study: Study, known: Mapping[str, Observations] = MappingProxyType({})) -> Inputs:
    """Read every trial of a study.

    Parameters
    ----------
    known
        Trial -> its observations as a first look has read and edited them, where it has.

    Raises
    ------
    DataError
        If a file cannot be used.
    """
    observed = tuple((t, known.get(t.name) or until_end(study, t, read_trial(study, t), {})) for t in study.trials)
    for _, o in observed:
        if not o.used:
            raise DataError(f"{o.file}: found no measured value, needed at least one; leave this trial out")
        check_event_rows(o)
    refuse_seen_points(observed)
    observed = tuple((with_ball(study, with_free_start(study, t, o), o), o) for t, o in observed)
    study = dataclasses.replace(study, trials=tuple(t for t, _ in observed))
    training = tuple((t, o) for t, o in observed if not t.held_out)
    free_parameters = free_parameters_of(study, training)
    # A camera error can be a candidate only if it shows in every training trial.
    cameras = [set(study.camera_priors(t, o)) for t, o in training]
    shared = [n for n in study.camera_priors(*training[0]) if all(n in c for c in cameras)]
    if any(t.in_mid_swing for t, _ in training):  # the clock of its start is that of its first point
        shared = [n for n in shared if n != "clock_offset"]
    data = tuple(trial_data(t, o) for t, o in training)
    held_out = tuple((trial_data(t, o), free_parameters_of(study, [(t, o)])) for t, o in observed if t.held_out)
    return Inputs(
        study=study,
        observed=observed,
        training=data,
        free_parameters=free_parameters,
        held_out=held_out,
        library=candidates(study, free_parameters, shared),
    )

"""Everything read from a study's files, made ready to be fitted."""

from __future__ import annotations

from dataclasses import dataclass

from looping_pendulum.discrepancy.data.observations import DataError, Observations
from looping_pendulum.discrepancy.data.study import Study, Trial, read_trial
from looping_pendulum.discrepancy.fit.event_prediction import check_events
from looping_pendulum.discrepancy.fit.other_units import refuse_other_units
from looping_pendulum.discrepancy.fit.problem import FreeParameter, Problem, TrialData, free_parameters_of
from looping_pendulum.discrepancy.fit.residual import data_of
from looping_pendulum.discrepancy.listed.candidates import Candidate, candidates


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """Everything read from a study's files."""

    study: Study
    observed: tuple[tuple[Trial, Observations], ...]
    training: tuple[TrialData, ...]
    numbers: tuple[FreeParameter, ...]
    held: tuple[tuple[TrialData, tuple[FreeParameter, ...]], ...]
    library: tuple[Candidate, ...]


def read_inputs(study: Study) -> Inputs:
    """Read every trial.

    Raises
    ------
    DataError
        If a file cannot be used, or its lengths or times are in another unit than the study says.
    """
    observed = tuple((t, read_trial(study, t)) for t in study.trials)
    for _, o in observed:
        if not o.used:
            raise DataError(f"{o.file}: found no measured value, needed at least one; leave this trial out")
        check_events(o)
    training = tuple((t, o) for t, o in observed if not t.held_out)
    numbers = free_parameters_of(study, training)
    cameras = [set(study.camera_priors(t, o)) for t, o in training]
    shared = [n for n in study.camera_priors(*training[0]) if all(n in c for c in cameras)]
    data = tuple(data_of(t, o) for t, o in training)
    held = tuple((data_of(t, o), free_parameters_of(study, [(t, o)])) for t, o in observed if t.held_out)
    for part, own in ((data, numbers), *(((one,), few) for one, few in held)):
        refuse_other_units(Problem(study, part, own))
    return Inputs(
        study=study,
        observed=observed,
        training=data,
        numbers=numbers,
        held=held,
        library=candidates(study, numbers, shared),
    )

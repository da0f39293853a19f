"""An identification with every part that its page can show; nothing of it was fitted."""

import dataclasses
from typing import Any

import numpy as np

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.laws import Closure
from looping_pendulum.discrepancy.fit.calibration import FittedParameter
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.residual import ModelTest
from looping_pendulum.discrepancy.formulas import ForceProfile, Unlisted
from looping_pendulum.discrepancy.result import (
    EventResidual,
    FitReport,
    FittedEffect,
    Identification,
    Outliers,
    PredictedTrial,
    RankedExplanation,
    TrialError,
    Verdict,
)
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.observations import Channel, EventObservation
from looping_pendulum.measured.study import Trial
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release


def named(effect: FittedEffect, name: str, **changes: Any) -> FittedEffect:
    """Return an effect as if another candidate were fitted."""
    return dataclasses.replace(effect, candidate=dataclasses.replace(effect.candidate, name=name, **changes))


def law(target: str, coordinate: str) -> Closure:
    """Return a law of a target and a coordinate; where its centres are, no report shows."""
    return Closure(coordinate=coordinate, factor="constant", target=target, first_centre=0.0, spacing=0.1)


def tracked(name: str, values: dict[str, Array], t: Array) -> PredictedTrial:
    """Return a trial of these channels, whose fourth point is an outlier, and which both models predict as it is."""
    channels = tuple(Channel(name=channel, t=t, value=value) for channel, value in values.items())
    sigma, is_outlier = np.ones(len(values) * len(t)), np.tile(np.arange(len(t)) == 3, len(values))
    data = TrialData(
        trial=Trial(name=name, files=(), release=Release.LOOPING), channels=channels, sigma=sigma, outliers=is_outlier
    )
    residuals = {"before": 3 * data.value, "after": data.value}
    predicted = {"before": data.value, "after": data.value}
    return PredictedTrial(
        data=data, held_out=False, predicted=predicted, residuals=residuals, chi2={"before": 9.0, "after": 1.0}
    )


def identification(name: str) -> Identification:
    """With ``name`` as the name of the study, of its trial and of the effect."""
    t = np.linspace(0.0, 1.0, 50)
    wave = np.sin(9 * t)
    parameter = FreeParameter(name=name, parameter="k", trials=(name,), init_value=1.1, scale=0.1, prior=1.0)
    fit = FitReport(
        parameters=(FittedParameter(parameter=parameter, value=1.0, error=0.1, at_bound=False),),
        correlations=(),
        condition_number=10.0,
        start_costs=(),
        tests=(ModelTest(subject=name, statistic=name, value=2.0, limit=1.0, failure=name),),
    )
    candidate = Candidate(
        name=name, kind="force", acts_on="light mass", depends_on=("speed",), formula="F = -k v", source="", parameter="k",
        role=ParameterRole.SET, null=0.0, bounds=(0.0, 1.0), unit="N s/m", trials=(name,),
    )  # fmt: skip
    effect = FittedEffect(candidate=candidate, value=0.01, error=0.001)
    other = named(effect, f"{name}2")
    by_length = law("light mass", "free_length")
    explanations = (
        RankedExplanation(effects=(effect,), law=by_length, probability=0.97, log10_odds=60.0, credible=True),
        RankedExplanation(effects=(effect,), law=None, probability=0.03, log10_odds=58.5, credible=False),
        RankedExplanation(effects=(effect, other), law=None, probability=None, log10_odds=57.0, credible=False),
        RankedExplanation(effects=(), law=None, probability=1e-60, log10_odds=0.0, credible=False),
    )
    profile = ForceProfile(
        side="along", coordinate=tuple(t), value=tuple(wave), error=(0.1,) * len(t), largest=1.0, largest_at=0.2,
        significant_from=0.1, significant_to=0.3, formula="radial basis functions", formula_values=tuple(wave),
    )  # fmt: skip
    force = Unlisted(
        law=by_length, profiles=(profile,), formula=None, log_bayes_factor=50.0, held_out_chi2_before=3.0,
        held_out_chi2_after=1.0,
    )  # fmt: skip
    picture = tracked(name, {"light_x": wave, "light_y": -wave}, t)
    outliers = Outliers(
        trial=name, held_out=False, channels=("light_x", "light_y"), count=1, of=len(t), intervals=((t[3], t[3]),),
        largest_distance=0.03, unit="m",
    )  # fmt: skip
    return Identification(
        study=name,
        title=name,
        seed=0,
        verdict=Verdict.UNLISTED,
        sentence=name,
        effects=(effect,),
        explanations=explanations,
        explanations_fitted=31,
        unlisted=force,
        correlated_noise={},
        smallest_visible=(),
        next_experiments=(),
        errors=(
            TrialError(trial=name, held_out=False, rms_before=3e-3, rms_after=1e-3,
                       standardised_rms_before=3.0, standardised_rms_after=1.0),
        ),
        events=(
            EventResidual(trial=name, held_out=False, before=0.5, after=None,
                          event=EventObservation(quantity="halting_time", index=1, unit="s", value=0.4, sigma=0.01)),
        ),
        outliers=(outliers,),
        before=fit,
        after=fit,
        judged_on="held-out trials",
        data=(name,),
        provenance={"looping-pendulum": "0"},
        scenario="",
        trial_figures=(picture,),
    )  # fmt: skip

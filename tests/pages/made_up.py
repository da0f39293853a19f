"""An identification with every part that its page can show; nothing of it was fitted."""

import dataclasses

import numpy as np

from looping_pendulum.discrepancy.result import (
    EventResidual,
    FitReport,
    FittedParameter,
    ForceProfile,
    Identification,
    IdentifiedEffect,
    Outliers,
    RankedExplanation,
    TrialError,
    TrialFigure,
    Unlisted,
    UnlistedLaw,
    Verdict,
)


def identification(name: str) -> Identification:
    """With ``name`` as the name of the study, of its trial and of the effect."""
    t = np.linspace(0.0, 1.0, 50)
    wave = np.sin(9 * t)
    fit = FitReport(
        parameters=(FittedParameter(name=name, value=1.0, error=0.1, measured=1.1, measured_error=0.1, at_bound=False),),
        correlations=(),
        condition_number=10.0,
        chi2_per_dof=2.0,
        held_out_chi2=2.0,
        failed_tests=(name,),
        start_costs=(),
    )
    effect = IdentifiedEffect(
        name=name, kind="force", acts_on="light mass", depends_on=("speed",), formula="F = -k v", source="", parameter="k",
        meaning="is", value=0.01, error=0.001, interval=None, null_value=0.0, unit="N s/m", companions=(),
    )  # fmt: skip
    other = dataclasses.replace(effect, name=f"{name}2")
    law = UnlistedLaw(acts_on="light mass", depends_on="free_length")
    explanations = (
        RankedExplanation(effects=(effect,), law=law, probability=0.97, log10_odds=60.0, credible=True),
        RankedExplanation(effects=(effect,), law=None, probability=0.03, log10_odds=58.5, credible=False),
        RankedExplanation(effects=(effect, other), law=None, probability=None, log10_odds=57.0, credible=False),
        RankedExplanation(effects=(), law=None, probability=1e-60, log10_odds=0.0, credible=False),
    )
    profile = ForceProfile(
        side="along", coordinate=tuple(t), value=tuple(wave), error=(0.1,) * len(t), largest=1.0, largest_at=0.2,
        significant_from=0.1, significant_to=0.3, formula="radial basis functions", fitted_formula_values=tuple(wave),
    )  # fmt: skip
    force = Unlisted(
        acts_on="light mass", depends_on="free_length", multiplied_by="constant", unit="m", profiles=(profile,), formula=None,
        formulas=(), phase="while sliding", log_bayes_factor=50.0, held_out_chi2_before=3.0, held_out_chi2_after=1.0,
    )  # fmt: skip
    picture = TrialFigure(
        trial=name,
        held_out=False,
        channels=("light_x", "light_y"),
        **{
            part: {"light_x": values, "light_y": -values}
            for part, values in (
                ("measured", wave), ("before", wave), ("after", wave), ("residual_before", 3 * wave), ("residual_after", wave)
            )
        },
        t={"light_x": t, "light_y": t},
        outliers={"light_x": t == t[3], "light_y": t == t[3]},
    )  # fmt: skip
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
        correlated_noise=(),
        record_starts=(),
        smallest_visible=(),
        next_experiments=(),
        errors=(
            TrialError(trial=name, held_out=False, rms_before=3e-3, rms_after=1e-3,
                       standardised_rms_before=3.0, standardised_rms_after=1.0,
                       events_before={}, events_after={}),
        ),
        events=(
            EventResidual(trial=name, held_out=False, quantity="halting_time", index=1, unit="s", measured=0.4, sigma=0.01,
                          before=0.5, after=None),
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

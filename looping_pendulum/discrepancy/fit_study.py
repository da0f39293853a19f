"""Fit the declared model of a study alone, without a search for what it lacks."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.special import gammaincinv
from threadpoolctl import threadpool_limits

from looping_pendulum.discrepancy.evidence.explain import fit_declared_model
from looping_pendulum.discrepancy.evidence.search import Search
from looping_pendulum.discrepancy.fit.calibration import Fit, FittedParameter
from looping_pendulum.discrepancy.fit.data import CorrelatedNoise, noises_of
from looping_pendulum.discrepancy.fit.likelihood import interval_end
from looping_pendulum.discrepancy.fit.residual import ResidualTests, failures_in_words
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.look.check import take_first_look
from looping_pendulum.discrepancy.result import (
    PredictedTrial,
    predicted_trial,
    residual_rows,
    rms_of_position,
    unit_of_position,
)
from looping_pendulum.discrepancy.verdict import BODY_IN_WORDS, UNIT_OF_BODY
from looping_pendulum.errors import ParameterError
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.study import Study
from looping_pendulum.pages.numbers import quantity, unit_in_words
from looping_pendulum.pages.tables import data_frame, text_table
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.quantities import QUANTITIES

Table = Literal["parameters", "trials", "residuals"]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StudyFit:
    """Fit of the declared model of a study to all its trials; `repr` shows its parameters.

    A parameter has the name that it has in a study, with that of the trial before it where it is of a single one:
    "light_drag", "first.release_angle". All values are in SI units and radians.
    """

    fit: Fit
    """The fit, with the covariance matrix of its scaled parameters."""
    tests: ResidualTests
    """Whether what is left looks like noise."""
    notes: tuple[str, ...]
    """What looked wrong or unusual before the fit."""

    @property
    def parameters(self) -> tuple[FittedParameter, ...]:
        """Return every free parameter with its start, value and error."""
        return self.fit.parameters

    @property
    def values(self) -> dict[str, float]:
        """Return parameter -> fitted value [SI]."""
        return self.fit.values

    @property
    def errors(self) -> dict[str, float]:
        """Return parameter -> standard error [SI], those of measured values that were fitted included."""
        return self.fit.errors

    @cached_property
    def correlations(self) -> dict[str, dict[str, float]]:
        """Return parameter -> every parameter -> correlation of both, from -1 to 1."""
        sigma = np.sqrt(np.maximum(np.diag(self.fit.covariance), 1e-300))
        names, matrix = self.fit.problem.names, self.fit.covariance / np.outer(sigma, sigma)
        return {name: dict(zip(names, row, strict=True)) for name, row in zip(names, matrix.tolist(), strict=True)}

    @cached_property
    def trials(self) -> tuple[PredictedTrial, ...]:
        """Return the data of every trial beside what the model predicts."""
        return tuple(predicted_trial({"before": self.fit}, k, held_out=False) for k in range(len(self.fit.problem.data)))

    @property
    def residuals(self) -> dict[str, dict[str, Array]]:
        """Return trial -> channel -> measured less predicted [SI], shape (n,), outliers included."""
        return {
            t.data.trial.name: {name: (t.data.value - t.predicted["before"])[part] for name, part in t.data.slices.items()}
            for t in self.trials
        }

    @property
    def converged(self) -> bool:
        """Whether the fit ended at a minimum."""
        return self.fit.converged

    @property
    def correlated_noise(self) -> dict[str, CorrelatedNoise]:
        """Return body -> errors of its points that last longer than a frame; empty: they are white noise.

        What the model lacks may be taken for these, which `identify` tells apart.
        """
        return noises_of(self.fit.problem.data)

    def interval(self, name: str, probability: float = 0.95) -> tuple[float | None, float | None]:
        """Return where a parameter lies with a probability, by its profile likelihood: all others are refitted.

        An end that is None: the data set no limit on that side.

        Raises
        ------
        ParameterError
            If no such parameter was fitted, or the probability is not between 0 and 1.
        """
        names = self.fit.problem.names
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise ParameterError(f"interval: found '{name}', needed one of: {', '.join(names)}{hint}")
        if not 0 < probability < 1:
            raise ParameterError(f"probability: found {probability}, needed a number between 0 and 1; write for example 0.95")
        rise = 2 * float(gammaincinv(0.5, probability))  # quantile of chi2 of one degree of freedom
        return interval_end(self.fit, name, -1, rise), interval_end(self.fit, name, 1, rise)

    def rows(self, table: Table = "parameters") -> list[dict[str, Any]]:
        """Return one row for each parameter, each trial or each measured value [SI]."""
        if table == "residuals":
            return residual_rows(self.trials, {"before": ""})
        if table == "trials":
            return [
                {
                    "trial": t.data.trial.name,
                    "rms": rms_of_position(t, "before"),
                    "standardised_rms": float(np.sqrt(t.chi2["before"])),
                    "unit": unit_of_position(t.data),
                }
                for t in self.trials
            ]
        return [
            {
                "name": p.parameter.name,
                "value": p.value,
                "error": p.error,
                "unit": unit_in_words(self._unit(p.parameter.parameter)),
                "start": p.parameter.init_value,
                "start_error": p.parameter.sigma,
                "at_bound": p.at_bound,
            }
            for p in self.parameters
        ]

    def to_frame(self, table: Table = "parameters") -> Any:
        """Return `rows` as a `pandas.DataFrame`.

        Raises
        ------
        MissingPackageError
            If pandas is not installed.
        """
        return data_frame(self.rows(table))

    def _unit(self, parameter: str) -> str:
        """Return the SI unit of a parameter of the model or of a camera."""
        if parameter in QUANTITIES:
            return QUANTITIES[parameter].kind.unit
        known: Mapping[str, Any] = self.fit.problem.study.coefficients
        return str((known.get(parameter) or CAMERA[parameter]).unit)

    @property
    def summary(self) -> str:
        """How well the model fits, in one line."""
        converged = "" if self.converged else "; it has not converged"
        return f"{self.fit.problem.count} values, chi2 per degree of freedom {self.tests.chi2_per_dof:.3g}{converged}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What else is known: errors that last, strong correlations, and which tests fail."""
        noise = " and ".join(
            f"{BODY_IN_WORDS[body]} {quantity(n.amplitude, UNIT_OF_BODY[body])} for some {quantity(n.correlation_time, 's')}"
            for body, n in self.correlated_noise.items()
        )
        pairs = "; ".join(f"{a} and {b} {c:.3f}" for a, b, c in self.fit.correlations())
        return (
            *([f"Errors that last, or what the model lacks: {noise}; `identify` tells which"] if noise else []),
            *([f"Correlations above 0.9: {pairs}"] if pairs else []),
            f"What fails: {'; '.join(failures_in_words(self.tests.results)) or 'nothing'}",
        )

    def __repr__(self) -> str:
        """Return the parameters as a table, and the remarks."""
        heading = f"Fit of {self.fit.problem.study.name}: {self.summary}"
        return "\n".join([heading, text_table(self.rows()), *self.remarks])


def fit(study: Study, *, seed: int = 0, anyway: bool = False) -> StudyFit:
    """Fit the declared model of a study to all its trials, held-out ones included, as `identify` does before it searches.

    Parameters
    ----------
    seed
        Seed of the random second start.
    anyway
        Whether to fit even if the tracked points contradict the declaration. What looks wrong is then among the notes.

    Raises
    ------
    DataError
        If the data cannot be used.
    DeclarationError
        If the tracked points contradict the declaration, and ``anyway`` is false.
    FitError
        If the declared model cannot run.
    """
    with threadpool_limits(1, user_api="blas"):  # as in `identify`, for the same digits
        first_look = take_first_look(study)
        if not anyway:
            first_look.refuse_mistakes()
        fitted, _ = fit_declared_model(read_inputs(study, first_look.observations), seed)
        search = Search(fitted, ())  # which knows the most probable noise
        declared, tests = search.tested(search.best)
        return StudyFit(fit=declared, tests=tests, notes=first_look.notes)

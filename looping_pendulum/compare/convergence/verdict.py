"""Says what a limit means: converged, not converged, or another limit, with one sentence that names what to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from looping_pendulum.compare.convergence.limit import SIGNIFICANT_CHANGE, Limit, rms_norm, significant_change
from looping_pendulum.compare.convergence.result import PATH_END_TIMES, QUANTITIES, QuantityVerdict, Verdict
from looping_pendulum.engines.studies import Ladder
from looping_pendulum.pages.numbers import DISPLAY_UNITS, number, quantity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.units import pretty

RESOLUTION = dict.fromkeys(QUANTITIES, 1e-4)
"""Quantity -> difference that no longer matters [m], [s]: no film resolves a tenth of a millimetre or of a millisecond."""
LADDERS = "studies(), in docs/write-an-engine.md"
"""Section of the documentation on how an adapter offers ladders."""
Refinement = tuple[Array, float | None]
"""Change from a variant's own settings to a ladder's limit and its uncertainty; to the finest rung and None without a limit."""


def verdict_of(to_limit: float, limit_error: float, uncertainty: float, resolution: float) -> Verdict:
    """Return the verdict on a value that is ``to_limit`` from its limit, which is ``limit_error`` from the reference."""
    if limit_error > max(uncertainty, resolution):
        return Verdict.ANOTHER_LIMIT
    return Verdict.CONVERGED if max(to_limit, uncertainty) <= resolution else Verdict.NOT_CONVERGED


def ladder_verdict(
    name: str, ladder: Ladder, errors: Sequence[Array | None], limit: Limit | None, refinement: Refinement | None
) -> QuantityVerdict:
    """Return the verdict on quantity ``name`` along one ladder.

    Parameters
    ----------
    errors
        Engine less reference of each rung, from coarse to fine, shape (samples, components); None: it has no value.
    limit
        Limit of the errors, whose own size is therefore its distance from the reference.
    """
    known = [error for error in errors if error is not None]
    verdict = Verdict.NOT_CONVERGED
    if limit is None:
        if len(known) < len(errors):
            why = f"{len(known)} of {len(errors)} rungs have a value; see the remarks of the others"
        else:
            away = [shown(name, rms_norm(error - known[-1])) for error in known[-3:-1]]
            why = f"the finest rung is {' and '.join(away)} from those before it; add finer rungs, or refine other settings too"
    else:
        distance, size = rms_norm(known[-1] - limit.value), rms_norm(limit.value)
        verdict = verdict_of(distance, size, limit.uncertainty, RESOLUTION[name])
        order = "" if limit.order is None else f" (order {number(limit.order, digits=2)})"
        why = f"its limit{order} is {shown(name, size, limit.uncertainty)} from the reference"
        if verdict is Verdict.CONVERGED:
            close = [error is None or rms_norm(error - limit.value) <= RESOLUTION[name] for error in errors]
            enough = next(value for k, value in enumerate(ladder.values) if all(close[k:]))
            why += f"; {format_setting(enough, ladder.unit)} is fine enough"
        elif verdict is Verdict.ANOTHER_LIMIT:
            why += "; refine the other settings, or look for the cause in the model"
        elif limit.order is None and distance <= RESOLUTION[name]:
            why += ", as well as the noise of single runs lets it be known; average several starts"
        else:
            why += f", {shown(name, distance)} from the finest rung; add finer rungs"
    signed = None if limit is None else rms_norm(limit.value) if name in PATH_END_TIMES else float(limit.value[0, 0])
    return QuantityVerdict(
        quantity=name,
        verdict=verdict,
        sentence=f"{verdict}: {why}",
        refinement=None if refinement is None else rms_norm(refinement[0]),
        limit_error=signed,
        uncertainty=None if limit is None else limit.uncertainty,
        order=None if limit is None else limit.order,
    )


def variant_verdict(
    name: str, own: Array | None, refinements: Mapping[str, Refinement], choices: Mapping[str, float | None], noise: float
) -> QuantityVerdict:
    """Return the verdict of all ladders together on quantity ``name`` at a variant's own settings.

    The ladders are assumed to act independently, so that their changes add up.

    Parameters
    ----------
    own
        Engine less reference, shape (samples, components); None: the variant's run has no value.
    refinements
        By the setting that is refined.
    choices
        Another choice of the adapter -> change that it makes.
    noise
        Standard deviation of a run.
    """
    changes = {setting: rms_norm(change) for setting, (change, _) in refinements.items()}
    setting = max(changes, key=lambda one: changes[one], default="")
    half_widths = [half_width for _, half_width in refinements.values() if half_width is not None]
    verdict, limit_error, uncertainty = Verdict.NOT_CONVERGED, None, None
    if own is None:
        why = "its run at its own settings broke off or never halts; take another profile or variant"
    elif not refinements:
        why = f"the adapter offers no ladder with a value ({LADDERS})"
    elif len(half_widths) < len(refinements):
        without = ", ".join(one for one, (_, half_width) in refinements.items() if half_width is None)
        largest = changes[setting] > RESOLUTION[name]
        todo = f"refine {setting} further, which changes it by {shown(name, changes[setting])}" if largest else "see its rungs"
        why = f"no limit along {without}; {todo}"
    else:
        total = np.sum([change for change, _ in refinements.values()], axis=0)
        limit_error = rms_norm(own + total)
        uncertainty = float(np.linalg.norm([SIGNIFICANT_CHANGE * noise, *half_widths]))
        verdict = verdict_of(rms_norm(total), limit_error, uncertainty, RESOLUTION[name])
        why = f"all ladders together lead to {shown(name, limit_error, uncertainty)} from the reference"
        if verdict is Verdict.CONVERGED:
            why += f"; its own settings are fine enough for {shown(name, RESOLUTION[name])}"
        elif verdict is Verdict.ANOTHER_LIMIT:
            as_large = [what for what, moved in choices.items() if moved is not None and abs(moved) >= limit_error]
            why += f"; try the other choice, {as_large[0]}" if as_large else "; take a variant with another model"
        elif max(RESOLUTION[name], changes[setting]) <= significant_change(noise):
            why += "; small changes of the start move it by as much: average several starts"
        else:
            why += f"; refine {setting} further, which changes it by {shown(name, changes[setting])}"
    return QuantityVerdict(
        quantity=name,
        verdict=verdict,
        sentence=f"{verdict}: {why}",
        refinement=changes.get(setting),
        limit_error=limit_error,
        uncertainty=uncertainty,
    )


def format_setting(value: float, unit: str) -> str:
    """Format the value of a setting with a suitable unit; angles stay in radians, as in the settings."""
    return f"{number(value)} rad" if unit == "rad" else quantity(value, pretty(unit), 3)


def shown(name: str, size: float, uncertainty: float | None = None) -> str:
    """Format a size of a quantity in its unit, with its uncertainty if there is one."""
    unit, scale = DISPLAY_UNITS[QUANTITIES[name]]
    half_width = "" if uncertainty is None else f" ± {number(uncertainty, scale, 2)}"
    return f"{number(size, scale, 2)}{half_width} {unit}"

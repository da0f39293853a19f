"""Check what an engine returns, in the process where it ran, so that a fault costs only its own result.

Third-party engines return whatever they like; reports and files rely on the shapes and types that `Trajectory` states.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import (
    SAMPLE_INTERVAL,
    UNKNOWN_MODE,
    Provenance,
    RunStatus,
    Supplier,
    Supplies,
    Supply,
    Trajectory,
    TrajectoryEvent,
)
from looping_pendulum.scenarios.scenario import Scenario

VECTOR_FIELDS = ("light_position", "light_velocity", "heavy_position", "heavy_velocity")
"""Fields that are arrays of shape (n, 2)."""
SCALAR_FIELDS = ("free_length", "wrap_angle", "string_stretch")
"""Fields that are arrays of shape (n,)."""
TENSIONS = ("light_tension", "heavy_tension")
"""Fields that are arrays of shape (n,) or None."""
MODES = frozenset({UNKNOWN_MODE, *(mode.value for mode in Mode)})
"""Values that the field `mode` may have."""


def validate_trajectory(returned: object, engine: Engine, scenario: Scenario) -> Trajectory:
    """Return the trajectory that ``engine`` returned, with its fields as plain NumPy arrays.

    A run that claims to have ended properly but has positions that are not finite gets the status NOT_FINITE.

    Raises
    ------
    EngineError
        If a field is not as `Trajectory` states; the message names the field, what was found and what was needed.
    """
    if not isinstance(returned, Trajectory):
        raise EngineError(f"simulate returned {type(returned).__name__}, needed a Trajectory")
    _check_scalar_fields(returned, engine)
    t = _times(returned, scenario)
    n = len(t)
    arrays: dict[str, Any] = {"t": t, "mode": _modes(returned.mode, n)}
    arrays |= {name: _numbers(name, getattr(returned, name), (n, 2)) for name in VECTOR_FIELDS}
    arrays |= {name: _numbers(name, getattr(returned, name), (n,)) for name in SCALAR_FIELDS}
    arrays |= {name: _numbers(name, value, (n,)) for name in TENSIONS if (value := getattr(returned, name)) is not None}
    trajectory = replace(returned, **arrays, events=_events(returned.events))
    finite = np.isfinite(trajectory.light_position).all() and np.isfinite(trajectory.heavy_position).all()
    return replace(trajectory, status=RunStatus.NOT_FINITE) if trajectory.status.ok and not finite else trajectory


def _field_error(field: str, actual: str, required: str) -> EngineError:
    """Return the error for one field."""
    return EngineError(f"simulate returned {field}: found {actual}, needed {required}")


def _numbers(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return ``value`` as an array of real numbers of this ``shape``.

    Only the field ``t`` determines how many samples there are.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise _field_error(name, f"what is no array ({error})", f"an array of shape {shape}") from None
    # Floats and integers, signed or not: no complex numbers, flags, texts or objects
    if array.dtype.kind not in "fiu":
        raise _field_error(name, f"an array of {array.dtype}", "one of real numbers")
    if array.shape != shape:
        raise _field_error(name, f"shape {array.shape}", f"{shape}")
    return np.array(array, dtype=float)


def _times(returned: Trajectory, scenario: Scenario) -> Array:
    """Return the sample times, which must rise and lie within the scenario's duration."""
    t = _numbers("t", returned.t, (np.size(returned.t),))
    if not (np.isfinite(t).all() and (np.diff(t) > 0).all()):
        raise _field_error("t", "times that do not grow or are no numbers", "rising times")
    if t.size and (t[0] < 0 or t[-1] > scenario.duration + SAMPLE_INTERVAL / 2):
        raise _field_error(
            "t", f"times from {t[0]:g} to {t[-1]:g} s", f"some within the scenario's 0 to {scenario.duration:g} s"
        )
    if returned.status.ok and not t.size:
        raise _field_error("t", f"no sample of a run that {returned.status.value!r}", "at least one")
    return t


def _modes(value: object, n: int) -> Any:
    """Return the modes as 8-bit integers, shape (n,)."""
    modes = _numbers("mode", value, (n,))
    unknown = sorted(set(modes.tolist()) - MODES)
    if unknown:
        known = ", ".join(f"{mode.value} ({mode.name.lower()})" for mode in Mode)
        raise _field_error("mode", f"{unknown[0]:g}", f"one of {known} or {UNKNOWN_MODE} (unknown)")
    return modes.astype(np.int8)


def _events(value: object) -> tuple[TrajectoryEvent, ...]:
    """Return the events, each with a finite time and a name."""
    if not isinstance(value, (tuple, list)):
        raise _field_error("events", type(value).__name__, "a tuple of TrajectoryEvent")
    for event in value:
        well_typed = isinstance(event, TrajectoryEvent) and isinstance(event.name, str) and _is_number(event.time)
        if not (well_typed and math.isfinite(event.time)):
            raise _field_error("events", repr(event)[:60], "TrajectoryEvent with a time [s] and a name")
    return tuple(TrajectoryEvent(time=float(event.time), name=event.name) for event in value)


def _is_number(value: object) -> bool:
    # In Python bool is a kind of int
    return isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)


def _require(ok: bool, field: str, value: object, required: str) -> None:
    if not ok:
        raise _field_error(field, repr(value)[:60], required)


def _require_type(field: str, value: object, kind: type, required: str) -> None:
    if not isinstance(value, kind):
        raise _field_error(field, type(value).__name__, required)


def _check_scalar_fields(returned: Trajectory, engine: Engine) -> None:
    """Refuse the names of another engine, and fields whose type the reports cannot take."""
    _require(isinstance(returned.status, RunStatus), "status", returned.status, "a RunStatus")
    names = {"engine": engine.name, "variant": engine.variant, "profile": engine.profile.value}
    for field, name in names.items():
        _require(getattr(returned, field) == name, field, getattr(returned, field), f"the engine's own, {name!r}")
    for field in ("scenario", "message", "output"):
        _require_type(field, getattr(returned, field), str, "text")
    for field in ("wall_time", "cpu_time"):
        _require(_is_number(getattr(returned, field)), field, getattr(returned, field), "a number of seconds")
    provenance = returned.provenance
    _require_type("provenance", provenance, Provenance, "a Provenance")
    versions = provenance.versions
    are_texts = isinstance(versions, dict) and all(isinstance(part, str) for pair in versions.items() for part in pair)
    _require(are_texts, "provenance.versions", versions, "a dict of package to version")
    _require_type("provenance.settings", provenance.settings, dict, "a dict")
    _require_type("provenance.supplies", provenance.supplies, Supplies, "Supplies")
    for name, supply in vars(provenance.supplies).items():
        is_supply = isinstance(supply, Supply) and isinstance(supply.by, Supplier) and isinstance(supply.how, str)
        _require(is_supply, f"provenance.supplies.{name}", supply, "a Supply")

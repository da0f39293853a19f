"""What an engine returns is checked where it ran: a fault there is a gap in its own row, and costs no other engine's result."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine
from looping_pendulum.engines.trajectory import (
    UNKNOWN_MODE,
    Provenance,
    RunStatus,
    Supplier,
    Supplies,
    Supply,
    Trajectory,
    TrajectoryEvent,
)
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.scenarios.scenario import Scenario

PLANES = ("light_position", "light_velocity", "heavy_position", "heavy_velocity")
"""Arrays of shape (n, 2)."""
SERIES = ("free_length", "wrap_angle", "string_stretch")
"""Arrays of shape (n,)."""
TENSIONS = ("light_tension", "heavy_tension")
"""The same, or None."""
MODES = frozenset({UNKNOWN_MODE, *(mode.value for mode in Mode)})


def checked(returned: object, engine: Engine, scenario: Scenario) -> Trajectory:
    """Return what ``engine`` gave back as plain arrays of numbers; one with a position that is no number did not end properly.

    Raises
    ------
    EngineError
        If it is not what `Trajectory` says, with the field, what was found and what was needed.
    """
    if not isinstance(returned, Trajectory):
        raise EngineError(f"simulate returned {type(returned).__name__}, needed a Trajectory")
    _check_words(returned, engine)
    t = _times(returned, scenario)
    n = len(t)
    arrays: dict[str, Any] = {"t": t, "mode": _modes(returned.mode, n)}
    arrays |= {name: _numbers(name, getattr(returned, name), (n, 2)) for name in PLANES}
    arrays |= {name: _numbers(name, getattr(returned, name), (n,)) for name in SERIES}
    arrays |= {name: _numbers(name, value, (n,)) for name in TENSIONS if (value := getattr(returned, name)) is not None}
    trajectory = replace(returned, **arrays, events=_events(returned.events))
    finite = np.isfinite(trajectory.light_position).all() and np.isfinite(trajectory.heavy_position).all()
    return replace(trajectory, status=RunStatus.NOT_FINITE) if trajectory.status.ok and not finite else trajectory


def _fault(field: str, found: str, needed: str) -> EngineError:
    return EngineError(f"simulate returned {field}: found {found}, needed {needed}")


def _numbers(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Real numbers of this shape; only ``t`` says how many samples there are."""
    try:
        found = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise _fault(name, f"what is no array ({error})", f"an array of shape {shape}") from None
    if found.dtype.kind not in "fiu":
        raise _fault(name, f"an array of {found.dtype}", "one of real numbers")
    if found.shape != shape:
        raise _fault(name, f"shape {found.shape}", f"{shape}")
    return np.array(found, dtype=float)


def _times(returned: Trajectory, scenario: Scenario) -> Array:
    t = _numbers("t", returned.t, (np.size(returned.t),))
    if not (np.isfinite(t).all() and (np.diff(t) > 0).all()):
        raise _fault("t", "times that do not grow or are no numbers", "rising times")
    if t.size and (t[0] < 0 or t[-1] > scenario.duration + SAMPLE_INTERVAL / 2):
        raise _fault("t", f"times from {t[0]:g} to {t[-1]:g} s", f"some within the scenario's 0 to {scenario.duration:g} s")
    if returned.status.ok and not t.size:
        raise _fault("t", f"no sample of a run that {returned.status.value!r}", "at least one")
    return t


def _modes(value: object, n: int) -> Any:
    found = _numbers("mode", value, (n,))
    unknown = sorted(set(found.tolist()) - MODES)
    if unknown:
        known = ", ".join(f"{mode.value} ({mode.name.lower()})" for mode in Mode)
        raise _fault("mode", f"{unknown[0]:g}", f"one of {known} or {UNKNOWN_MODE} (unknown)")
    return found.astype(np.int8)


def _events(value: object) -> tuple[TrajectoryEvent, ...]:
    if not isinstance(value, (tuple, list)):
        raise _fault("events", type(value).__name__, "a tuple of TrajectoryEvent")
    for event in value:
        good = isinstance(event, TrajectoryEvent) and isinstance(event.name, str) and _is_number(event.time)
        if not (good and math.isfinite(event.time)):
            raise _fault("events", repr(event)[:60], "TrajectoryEvent with a time [s] and a name")
    return tuple(TrajectoryEvent(time=float(event.time), name=event.name) for event in value)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)


def _check_words(returned: Trajectory, engine: Engine) -> None:
    """Refuse another run's name, and fields of another kind than the reports take."""
    if not isinstance(returned.status, RunStatus):
        raise _fault("status", repr(returned.status)[:60], "a RunStatus")
    names = {"engine": engine.name, "variant": engine.variant, "profile": engine.profile.value}
    for field, needed in names.items():
        found = getattr(returned, field)
        if found != needed:
            raise _fault(field, repr(found)[:60], f"the engine's own, {needed!r}")
    for field in ("scenario", "message", "output"):
        if not isinstance(getattr(returned, field), str):
            raise _fault(field, type(getattr(returned, field)).__name__, "text")
    if not _is_number(returned.wall_time):
        raise _fault("wall_time", repr(returned.wall_time)[:60], "a number of seconds")
    _check_provenance(returned.provenance)


def _check_provenance(found: object) -> None:
    if not isinstance(found, Provenance):
        raise _fault("provenance", type(found).__name__, "a Provenance")
    if not (
        isinstance(found.versions, dict) and all(isinstance(part, str) for pair in found.versions.items() for part in pair)
    ):
        raise _fault("provenance.versions", repr(found.versions)[:60], "a dict of package to version")
    if not isinstance(found.settings, dict):
        raise _fault("provenance.settings", type(found.settings).__name__, "a dict")
    if not isinstance(found.supplies, Supplies):
        raise _fault("provenance.supplies", type(found.supplies).__name__, "Supplies")
    for name, supply in vars(found.supplies).items():
        if not (isinstance(supply, Supply) and isinstance(supply.by, Supplier) and isinstance(supply.how, str)):
            raise _fault(f"provenance.supplies.{name}", repr(supply)[:60], "a Supply")

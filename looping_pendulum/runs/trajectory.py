"""The result of every engine: samples of the motion, how the run ended, and who supplied which physics."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release

FIELDS = MappingProxyType(
    {
        "t": ("t",),
        "light_position": ("light_x", "light_y"),
        "light_velocity": ("light_vx", "light_vy"),
        "heavy_position": ("heavy_x", "heavy_y"),
        "heavy_velocity": ("heavy_vx", "heavy_vy"),
        "string_stretch": ("string_stretch",),
        "string_slip": ("string_slip",),
        "free_length": ("free_length",),
        "wrap_angle": ("wrap_angle",),
        "mode": ("mode",),
        "light_tension": ("light_tension",),
        "heavy_tension": ("heavy_tension",),
    }
)
"""Array of a `Trajectory` -> names of its components; all of them in a row are one sample, SI, `ROW`."""
ROW = tuple(name for names in FIELDS.values() for name in names)
"""Values of a sample; NaN where a value is not known."""
COLUMNS = ROW[: ROW.index("string_slip") + 1]
"""Values of a sample that an engine records: positions from the rod's centre, x right and y up.

Stretch and slip of the string are NaN where an engine does not know them. The other values of `ROW` only an engine states which
knows them itself, as fields of a `Trajectory`.
"""
OPTIONAL = ("string_slip", "light_tension", "heavy_tension")
"""Arrays of a trajectory that are None where the engine does not report them."""

SAMPLE_INTERVAL = 1e-3
"""Time between samples [s]; every engine's step divides it, so that no trajectory is ever resampled."""

SAME_TIME = 1e-9
"""Largest difference of two times that count as equal [s]: sample times are multiples of a millisecond, but for rounding."""

LARGEST = 1e9
"""Largest position [m] or speed [m/s] that counts as a number: nothing is so far, and the squares of the largest overflow."""

UNKNOWN_MODE = -1
"""Mode of a sample whose engine does not report whether the string slides or sticks."""


class RunStatus(StrEnum):
    """How a run ended; the value is the sentence that a user reads."""

    FINISHED = "ran for the scenario's whole duration"
    LIGHT_REACHED_ROD = "ran until the light mass reached the rod"
    HEAVY_REACHED_ROD = "ran until the heavy mass reached the rod, where the model ends"
    STRING_LEFT_ROD = "ran until the string left the rod, where the model ends"
    STRING_DRIFT = "the string's length left its budget; raise solver iterations or shorten the time step"
    NOT_FINITE = "a position became infinite or not a number; shorten the time step"
    OUT_OF_REACH = "a mass flew farther from the rod than its string reaches; shorten the time step or raise solver iterations"
    TIME_LIMIT = "stopped by its time limit; raise --time-limit or use --profile quick"
    MEMORY_LIMIT = "stopped by its memory limit; raise --memory-limit or use --profile quick"
    DISK_LIMIT = "stopped because it wrote more files than a run may; let the engine write less"
    CRASHED = "the engine's process died; its output says more"
    FAILED = "the engine raised an error"
    MISSING = "the engine is not installed; `looping-pendulum engines` says how to get it"
    UNSUPPORTED = "the engine cannot represent this scenario"
    INTERRUPTED = "interrupted by the user; what was computed is kept"

    @property
    def ok(self) -> bool:
        """Return whether the run came to its proper end."""
        return self is RunStatus.FINISHED or self.ends_at_rod

    @property
    def ends_at_rod(self) -> bool:
        """Return whether a mass reached the rod or the string left it, before the scenario's duration was over."""
        return self in (RunStatus.LIGHT_REACHED_ROD, RunStatus.HEAVY_REACHED_ROD, RunStatus.STRING_LEFT_ROD)


class Supplier(StrEnum):
    """Who supplies a piece of physics.

    It matters because a result with a law that the adapter computes is no evidence that the engine obeys this law.
    """

    ENGINE = "engine"
    ADAPTER = "adapter"
    NOBODY = "nobody"


@dataclass(frozen=True, kw_only=True)
class Supply:
    """Who supplies one piece of physics, and how."""

    by: Supplier
    how: str
    """By which means, in a few words."""


@dataclass(frozen=True, kw_only=True)
class Supplies:
    """Suppliers of the physics in which engines and adapters differ."""

    winding: Supply
    friction_law: Supply
    stick_slip: Supply
    drag: Supply


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Versions, settings and suppliers with which a trajectory was computed."""

    versions: dict[str, str]
    """Package -> version."""
    settings: dict[str, Any]
    """Every numerical setting that changes the result, SI."""
    supplies: Supplies
    seed: int | None = None


@dataclass(frozen=True, kw_only=True)
class TrajectoryEvent:
    """An event of a run, such as a stop or the start of slack."""

    time: float
    """Time of the event [s]."""
    name: str


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """The motion that one engine computed. A failed run keeps what it has."""

    engine: str
    variant: str
    profile: str
    scenario: str
    t: Array
    """Sample times [s], shape (n,)."""
    light_position: Array
    """Light mass from the rod's centre, x right and y up [m], shape (n, 2)."""
    light_velocity: Array
    """Velocity of the light mass [m/s], shape (n, 2)."""
    heavy_position: Array
    """Heavy mass from the rod's centre [m], shape (n, 2)."""
    heavy_velocity: Array
    """Velocity of the heavy mass [m/s], shape (n, 2)."""
    free_length: Array
    """Length of the straight string to the light mass, from its position [m], shape (n,); NaN without a string."""
    wrap_angle: Array
    """Angle of string on the rod, with full turns counted [rad], shape (n,); NaN without a string."""
    string_stretch: Array
    """How much longer than its rest length the string is [m], shape (n,); NaN where the engine does not report it."""
    string_slip: Array | None = None
    """How far the string has slid over the rod, positive towards the heavy mass [m], shape (n,), where known."""
    mode: NDArray[np.int8]
    """Value of `reference_ode.transitions.Mode` per sample, `UNKNOWN_MODE` where the engine does not report it."""
    light_tension: Array | None = None
    """Tension in the free string [N], shape (n,), where known."""
    heavy_tension: Array | None = None
    """Tension above the heavy mass [N], shape (n,), where known."""
    events: tuple[TrajectoryEvent, ...] = ()
    status: RunStatus = RunStatus.FINISHED
    message: str = ""
    """Details of how the run ended, if it failed."""
    provenance: Provenance
    lacks: tuple[str, ...] = ()
    """Physics of the scenario that the run went without, as returned by `Abilities.lacks`."""
    additions: tuple[str, ...] = ()
    """What the adapter added beyond the engine, from `Abilities.additions`."""
    from_reference: tuple[str, ...] = ()
    """What the adapter took from the reference's own run, from `Abilities.from_reference`."""
    outside_range: tuple[str, ...] = ()
    """Quantities of the scenario outside the range in which the engine's accuracy was measured (`Abilities.outside_range`)."""
    wall_time: float = float("nan")
    """Wall time of the simulation, without building and starting it [s]."""
    cpu_time: float = float("nan")
    """Processor time of the same, of all threads [s]; NaN where the engine does not say it. Other work hardly changes it."""
    output: str = field(default="", repr=False)
    """Text that the engine printed."""

    @property
    def label(self) -> str:
        """Return engine and variant as one name, as `variant_label` does."""
        return variant_label(self.engine, self.variant)

    @property
    def heavy_drop(self) -> Array:
        """Return how far the heavy mass is below its release [m], shape (n,)."""
        if len(self.t) == 0:
            return np.empty(0)
        return np.asarray(self.heavy_position[0, 1] - self.heavy_position[:, 1])

    def raise_if_failed(self) -> Trajectory:
        """Return this trajectory if its run came to its proper end.

        Raises
        ------
        EngineError
            Otherwise, with the run's status and message.
        """
        if not self.status.ok:
            raise EngineError(f"{self.label}: {self.status.value}. {self.message}".strip())
        return self


def variant_label(engine: str, variant: str) -> str:
    """Return engine and variant as one name, "pymunk:chain"; the engine's name alone, "reference", if it has no variants."""
    return f"{engine}:{variant}" if variant else engine


def sample_times(duration: float) -> Array:
    """Return the times [s] of the samples of a run that lasts ``duration`` [s], shape (n,)."""
    # Whole numbers times the interval: with a fractional step, np.arange may or may not include the end, by rounding
    return np.arange(round(duration / SAMPLE_INTERVAL) + 1, dtype=np.float64) * SAMPLE_INTERVAL


def check_column_count(count: int) -> None:
    """Raise an EngineError if a sample with its time has not ``count`` values."""
    if count != len(COLUMNS):
        raise EngineError(
            f"a sample: found {count} values with its time, needed {len(COLUMNS)}: {', '.join(COLUMNS)}; "
            "a rig's read() gives all but t, and NaN for a stretch or slip that it does not know"
        )


def from_samples(samples: Array, *, parameters: Parameters, **fields: Any) -> Trajectory:
    """Return a trajectory made from samples; free length and wrap angle are computed from positions where they are not known.

    Parameters
    ----------
    samples
        Rows of `COLUMNS` or of `ROW`: shape (n, 11) or (n, 16). A column without any number is not known.
    fields
        Fields of the trajectory, in place of what the samples say, too.

    Raises
    ------
    EngineError
        If a sample has another number of values.
    """
    if samples.shape[1] != len(ROW):
        check_column_count(samples.shape[1])
        samples = np.column_stack([samples, np.full((len(samples), len(ROW) - len(COLUMNS)), np.nan)])
    arrays: dict[str, Any] = {}
    start = 0
    for field_name, names in FIELDS.items():
        arrays[field_name] = samples[:, start] if len(names) == 1 else samples[:, start : start + len(names)]
        start += len(names)
    unknown = [name for name, values in arrays.items() if not np.isfinite(values).any()]
    arrays |= {name: None for name in OPTIONAL if name in unknown}
    arrays["mode"] = np.where(np.isnan(arrays["mode"]), UNKNOWN_MODE, arrays["mode"]).astype(np.int8)
    if parameters.release is not Release.DROP:
        free_length, wrap_angle = string_coordinates(arrays["light_position"], parameters.rod_radius, parameters.release_angle)
        computed = {"free_length": free_length, "wrap_angle": wrap_angle}
        arrays |= {name: values for name, values in computed.items() if name in unknown}
    return Trajectory(**(arrays | fields))


def sample_rows(run: Trajectory) -> Array:
    """Return the samples of ``run`` as rows of `ROW`, shape (n, 16)."""
    arrays = (getattr(run, name) for name in FIELDS)
    return np.column_stack([np.full(len(run.t), np.nan) if values is None else values for values in arrays])


def supplies_as_rows(supplies: Supplies) -> list[tuple[str, str, str]]:
    """Return a row (piece of physics, supplier, how) for each piece, for tables."""
    return [
        (f.name.replace("_", " "), s.by.value, s.how) for f in dataclasses.fields(supplies) if (s := getattr(supplies, f.name))
    ]


def finite_length(run: Trajectory) -> int:
    """Return the number of samples before the first that is not finite, or above `LARGEST`."""
    if len(run.t) == 0:
        return 0
    columns = (run.light_position, run.heavy_position, run.heavy_velocity)
    bad = ~(np.abs(np.hstack(columns)) <= LARGEST).all(axis=1)  # NaN compares as false
    return int(np.argmax(bad)) if bad.any() else len(run.t)


def first_samples(run: Trajectory, count: int) -> Trajectory:
    """Return ``run`` reduced to its first ``count`` samples."""
    if count >= len(run.t):
        return run
    per_sample: dict[str, Any] = {
        f.name: value[:count] for f in dataclasses.fields(run) if isinstance(value := getattr(run, f.name), np.ndarray)
    }
    return dataclasses.replace(run, **per_sample)

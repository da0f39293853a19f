"""A reference in closed form: constant acceleration, constant braking, rest; the light mass winds at a constant rate."""

import dataclasses
import io
import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.category import StrCategoryFormatter
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FuncFormatter

from looping_pendulum.compare import compare
from looping_pendulum.compare.convergence import result as convergence_result
from looping_pendulum.compare.convergence.study import ReferenceTarget
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.measured.tables.events import MeasuredEventRow
from looping_pendulum.pages import drawing
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import (
    COLUMNS,
    Provenance,
    RunStatus,
    Supplier,
    Supplies,
    Supply,
    Trajectory,
    TrajectoryEvent,
    from_samples,
)
from looping_pendulum.scenarios.scenario import MeasuredTable, Scenario, Tolerance
from tests.compare import report_cells

FALL, BRAKE, TURN, RATE = 5.0, 40.0, 0.3, 6.0  # m/s^2, m/s^2, s, rad/s
HALT = TURN * (1 + FALL / BRAKE)

EVENTS = (("release", 0.0), ("stop", HALT), ("stick", HALT), ("halt", HALT), ("light_reaches_rod", 1.1))

SUPPLY = Supply(by=Supplier.ENGINE, how="by closed form")
SUPPLIES = Supplies(winding=SUPPLY, friction_law=SUPPLY, stick_slip=SUPPLY, drag=SUPPLY)
NO_FRICTION = dataclasses.replace(
    SUPPLIES,
    friction_law=Supply(by=Supplier.NOBODY, how="left out"),
    stick_slip=Supply(by=Supplier.NOBODY, how="left out"),
)

PARAMETERS = Parameters(
    light_mass=0.01,
    heavy_mass=0.1,
    rod_radius=0.00625,
    free_length=0.58,
    release_angle=math.radians(112),
    coefficients={"kinetic_friction": 0.34},
)


def drop(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drop [m] and downward speed [m/s] of the heavy mass."""
    falling, braking = np.minimum(t, TURN), np.clip(t - TURN, 0, HALT - TURN)
    top = FALL * TURN
    return 0.5 * FALL * falling**2 + top * braking - 0.5 * BRAKE * braking**2, FALL * falling - BRAKE * braking


def rows(t: np.ndarray, delay: float = 0.0) -> np.ndarray:
    at = np.maximum(t - delay, 0.0)
    fallen, speed = drop(at)
    p = PARAMETERS
    angle = p.release_angle + RATE * at
    free_length = p.string_length - p.hanging_length - fallen - p.rod_radius * angle
    x, y = light_position(np, free_length, angle, p.rod_radius)
    zero = np.zeros_like(t)
    vx, vy = (np.gradient(each, t) if len(t) > 1 else zero for each in (x, y))
    columns = (t, x, y, vx, vy, zero + p.rod_radius, -p.hanging_length - fallen, zero, -speed, zero, np.full_like(t, np.nan))
    assert len(columns) == len(COLUMNS)
    return np.column_stack(columns)


@pytest.fixture
def times() -> np.ndarray:
    return np.arange(1051) * 1e-3


@pytest.fixture
def closed_form() -> SimpleNamespace:
    """What the closed form says."""
    fallen = float(drop(np.array([HALT]))[0][0])
    angle = PARAMETERS.release_angle + RATE * HALT
    length = PARAMETERS.string_length - PARAMETERS.hanging_length - fallen - PARAMETERS.rod_radius * angle
    return SimpleNamespace(
        halt=HALT, drop=fallen, wrap_angle=angle, free_length=length, parameters=PARAMETERS, supplies=SUPPLIES
    )


@pytest.fixture
def make_run(times: np.ndarray) -> Callable[..., Trajectory]:
    """Run of the closed form: ``shift`` (x, y) [m], ``delay`` [s], ``until`` [s]; other fields as given."""

    def make(shift=(0.0, 0.0), delay=0.0, until=1.05, supplies=SUPPLIES, settings=None, samples=None, **fields) -> Trajectory:
        samples = rows(times[times <= until + 1e-9], delay) if samples is None else samples
        samples[:, 1:3] += shift
        defaults = {
            "parameters": PARAMETERS,
            "engine": "pymunk",
            "variant": "chain",
            "profile": "quick",
            "scenario": "made_up",
            "provenance": Provenance(versions={"pymunk": "7.3"}, settings=settings or {"dt": 1e-3}, supplies=supplies),
            "wall_time": 2.1,
            "cpu_time": 1.05,
        }
        return from_samples(samples, **(defaults | fields))

    return make


@pytest.fixture
def missing(make_run: Callable[..., Trajectory]) -> Trajectory:
    return make_run(
        samples=np.empty((0, len(COLUMNS))), engine="pybullet", status=RunStatus.MISSING, wall_time=math.nan, cpu_time=math.nan
    )


@pytest.fixture
def reference(make_run: Callable[..., Trajectory]) -> Callable[..., Trajectory]:
    """The closed form as a reference, to its end at 1.1 s."""

    def sample(t: np.ndarray, end: float = 1.1) -> Trajectory:
        t = t[t <= end]
        return make_run(
            samples=rows(t),
            engine="reference",
            variant="closed form",
            mode=np.where(t < HALT, Mode.SLIDING_DOWN, Mode.STICKING).astype(np.int8),
            events=tuple(TrajectoryEvent(time=time, name=name) for name, time in EVENTS),
        )

    return sample


@pytest.fixture
def scenario() -> Scenario:
    return Scenario(name="made_up", title="Made up", description="A closed form.", parameters=PARAMETERS, duration=1.05)


@pytest.fixture
def measured_scenario(scenario: Scenario) -> Scenario:
    trial = MeasuredTable(file="trial.csv", sha256="0", source="a table")
    return dataclasses.replace(scenario, measured=trial)


@pytest.fixture
def table() -> SimpleNamespace:
    names = ("quantity", "index", "measured", "paper_numerical", "unit")
    rows = (
        ("halting_time", 1, 0.3512, 0.34, "s"),
        ("drop_at_halt", 1, 0.25, 0.25, "m"),
        ("wrap_angle_at_halt", 1, None, 4.0, "rad"),
        ("x1_extremum", 99, 0.34, 0.34, "s"),
    )
    return [MeasuredEventRow(**dict(zip(names, row, strict=True))) for row in rows]


@pytest.fixture
def limit() -> Callable[..., Tolerance]:
    def make(metric: str, value: float, expected_failure: str = "", engine: str = "pymunk:chain") -> Tolerance:
        return Tolerance(
            engine=engine, profile="quick", metric=metric, limit=value, reason="by design", expected_failure=expected_failure
        )

    return make


@pytest.fixture
def no_friction() -> Supplies:
    return NO_FRICTION


DRAWN: set[str] = set()
"""Texts that were drawn before: a text alone is drawn alike every time, and most figures have the same words on their axes."""


def words(artist: Artist) -> set[str]:
    """All texts of an artist but those of ticks, which an axis would make when asked for its children: half of the time."""
    own = {artist.get_text()} if isinstance(artist, Text) else set()
    parts = (artist.label, artist.offsetText) if isinstance(artist, Axis) else artist.get_children()
    return own.union(*map(words, parts))


def texts_alone(figure: Figure) -> bytes:
    """Picture of nothing but a figure's texts, on top of each other; of the ticks' labels only those that are words."""
    texts = words(figure)
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if isinstance(axis.get_major_formatter(), (FixedFormatter, FuncFormatter, StrCategoryFormatter)):
            texts |= {label.get_text() for label in axis.get_ticklabels()}
    page = Figure(figsize=(1, 1), dpi=20)
    for text in sorted(texts - DRAWN):
        page.text(0, 0, text)
    out = io.BytesIO()
    page.savefig(out, format="png")
    DRAWN.update(texts)  # not if one of them raised: it has to fail the next figure, too
    return out.getvalue()


@pytest.fixture
def quick_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every figure is made, but only its texts are drawn: curves and layout take ten times as long."""
    monkeypatch.setattr(drawing, "png", texts_alone)


@pytest.fixture
def goal(scenario: Scenario, reference: Callable[..., Trajectory], closed_form: SimpleNamespace) -> ReferenceTarget:
    """The closed form as a target that knows its own halt."""
    numbers = {convergence_result.HALT: closed_form.halt, convergence_result.DROP: closed_form.drop}
    return ReferenceTarget(scenario=scenario, reference=reference, numbers=numbers)


@pytest.fixture
def result(scenario: Scenario, reference: Callable[..., Trajectory], make_run: Callable[..., Trajectory]) -> ComparisonResult:
    """A result whose only engine has the numbers of `report_cells`."""
    made = compare(scenario, reference, [make_run()])
    (engine,) = made.engines
    engine = dataclasses.replace(
        engine,
        landmarks=report_cells.OWN,
        metrics=report_cells.METRICS,
        tube=dataclasses.replace(engine.tube, fraction=0.97, first_exit=0.1234567),
        departures=(report_cells.gone(1e-3, 0.2345678), report_cells.gone(1e-2, 0.3456789)),
        growth_rate=12.34,
    )
    true = dataclasses.replace(made.reference, sampled=report_cells.TRUE)
    return report_cells.with_engine(dataclasses.replace(made, reference=true), engine)

"""What is fuzzed: where real inputs come from, how they are damaged, and what is done with one."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from unittest import mock

import numpy as np
from hypothesis.strategies import SearchStrategy
from pydantic_core import PydanticCustomError
from typer import BadParameter

from looping_pendulum.compare import baseline
from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.report import comparison_markdown
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.trajectories import stored_result, trajectory_csv
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.look.check import take_first_look
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import ReferenceEngine
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import file_stem
from looping_pendulum.measured import study_io
from looping_pendulum.measured.study_file import MeasuredField
from looping_pendulum.measured.tables import readers
from looping_pendulum.measured.tables.events import read_event_table
from looping_pendulum.runs.trajectory import Trajectory
from looping_pendulum.scenarios import dump, load, load_text
from looping_pendulum.scenarios.fields import QuantityField
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.scenarios.units import QUANTITY_NOUNS, QuantityKind, show, to_si
from looping_pendulum.sweep import map_file
from looping_pendulum.sweep.map_file import run_count
from looping_pendulum.teaching import tracker
from looping_pendulum.teaching.new_file import radius_of
from tests.fuzz import command_lines
from tests.fuzz.damage import damaged

PACKAGE = Path(__file__).parents[2] / "looping_pendulum"
EXAMPLE = PACKAGE / "teaching" / "example"


@dataclass(frozen=True, kw_only=True)
class InputKind:
    """One kind of input."""

    name: str
    seeds: Callable[[], Sequence[bytes]]
    """Real inputs; called once, in the folder where the inputs are run."""
    run: Callable[[bytes], None]
    """Accepts an input, or raises a `HarnessError`; anything else is a fault."""
    inputs: Callable[[Sequence[bytes]], SearchStrategy[bytes]] = damaged
    """From real inputs to damaged ones."""


class RefusedText(HarnessError):
    """A quantity was refused, which a reader of files would put into an error of one line."""


def _unit_seeds() -> list[bytes]:
    examples = [QuantityKind(unit=unit).example_text for unit in QUANTITY_NOUNS]
    measured = ["(65 +/- 1) cm", "10 g +/- 0.5 %", "free from 3 g"]
    spelled = ["9.81 m s^-2", "4 cm^2", "5 1/s", "112.5°", "−5 °", "512 MiB"]
    return [text.encode() for text in (*examples, *measured, *spelled)]


def run_quantity(data: bytes) -> None:
    """Read a text as every kind of quantity; what is read is finite, and is written so that it is read again."""
    text = data.decode("utf-8", "surrogateescape")
    refused: list[Exception] = []
    for unit in QUANTITY_NOUNS:
        try:
            value = QuantityField(QuantityKind(unit=unit)).read(text)
        except PydanticCustomError as error:
            refused.append(error)
        else:
            assert math.isfinite(value)
            assert to_si(show(value, unit), unit) == value
    attempts: list[Callable[[], object]] = [
        lambda: MeasuredField(QuantityKind(unit="kg"), start=1.0).read(text),
        lambda: MeasuredField(QuantityKind(unit="m")).read(text),
        lambda: radius_of(text),
    ]
    for attempt in attempts:
        try:
            attempt()
        except (HarnessError, PydanticCustomError, BadParameter) as error:
            refused.append(error)
    for error in refused:
        assert str(error).strip()
        assert len(str(error)) < 500, "an error quotes all of a long text"
    if len(refused) == len(QUANTITY_NOUNS) + len(attempts):
        raise RefusedText("refused by all")


def _scenario_seeds() -> list[bytes]:
    """Shipped scenarios, of the long ones the beginning: their tolerances are many times the same."""
    files = [EXAMPLE / "mine.scenario.yaml", *sorted((PACKAGE / "scenarios").glob("*.yaml"))]
    return [b"\n".join(path.read_bytes().split(b"\n")[:60]) for path in files]


def _map_seeds() -> list[bytes]:
    """Shipped maps, over a scenario that loads sooner than theirs."""
    import_module("scipy.stats")  # what a reader imports on its first use counts for no input
    files = sorted((PACKAGE / "sweep" / "maps").glob("*.yaml"))
    listed = b"""title: All keys
scenario: atwood
engine: [reference, "pymunk:chain"]
profile: quick
parameters:
  mass_ratio: [1, 2, 5]
  string.kinetic_friction: {from: 0.1, to: 1, count: 4, spacing: log}
duration: 2 s
chunk: 4
"""
    sampled = b"""title: A sample
scenario: held
parameters: {release_angle: {from: 60 deg, to: 90 deg}, rod_radius: {from: 1 mm, to: 2 mm}}
sample: {method: halton, count: 8, seed: 3}
"""
    return [path.read_bytes().replace(b"ten_to_one", b"held") for path in files] + [listed, sampled]


def run_scenario(data: bytes) -> None:
    """Load a scenario; what loads is dumped and loads again as an equal one."""
    Path("any.yaml").write_bytes(data)
    scenario = load("any.yaml")
    assert load_text(dump(scenario), "any.yaml") == scenario


def _study_seeds() -> list[bytes]:
    Path("trials").mkdir(exist_ok=True)
    for name in ("first.csv", "second.csv"):
        rows = (EXAMPLE / "trials" / name).read_bytes().split(b"\n")[:40]
        Path("trials", name).write_bytes(b"\n".join(rows) + b"\n")
    Path("trials", "one.csv").write_bytes(b"t,x,y\n" + b"".join(b"%d,%d,%d\n" % (4 * k, k % 7, -k % 5) for k in range(30)))
    Path("trials", "events.csv").write_bytes(EVENT_TABLES[1])
    study = (EXAMPLE / "study.yaml").read_bytes()
    rich = b"""title: All keys
apparatus: {light: {mass: 10 g +/- 1 %, radius: 5 mm}, rod: {radius: 6.25 mm}}
effects: {gravity: 9.81 m/s^2, capstan: {kinetic_friction: free from 0.2}, light_drag: 1e-3 kg/m +/- 10 %}
fit: [light_mass, kinetic_friction, release_angle]
trials:
- name: a
  files: {light: trials/one.csv}
  events: trials/events.csv
  kind: positions
  frame_rate: 240 Hz
  clip_rate: 30 Hz
  units: {length: cm, time: ms}
  mirrored: true
  heavy: {mass: 100 g}
  release: {kind: looping, angle: 112 deg +/- 1 deg, free_length: (58 +/- 1) cm, hanging_length: free from 3 cm}
  camera: {origin_x: 0 m +/- 1 mm, scale: 1 +/- 1 %, tilt: free, perspective_x: 0.05 1/m,
    distortion: free, centre_x: 3 cm, clock_offset: 3 ms, clock_ratio: 0.125}
- name: b
  file: trials/second.csv
  held_out: true
  dropped: light
  heavy: {mass: 60 g}
  release: {kind: vertical, free_length: 58 cm}
limits: {release_angle: [60 deg, 130 deg], mass_ratio: [2, 10], releases: [looping, held, vertical, drop]}
"""
    return [study, rich]


def run_study(data: bytes) -> None:
    """Load a study; what loads is dumped and loads again, and its trials are read as `identify` reads them."""
    Path("any.yaml").write_bytes(data)
    study = study_io.load("any.yaml")
    assert study_io.load_text(study_io.dump(study), "any.yaml") == study
    take_first_look(study)
    read_inputs(study)


def run_map(data: bytes) -> None:
    """Load a map; what loads has runs, whose parameters are finite."""
    Path("any.yaml").write_bytes(data)
    plan = map_file.load("any.yaml")
    map_file.refuse_unintended_size(plan)
    region = next(plan.regions())
    assert 0 < run_count(region) <= plan.runs
    if run_count(region) < 100_000:
        assert all(np.isfinite(column).all() for column in plan.columns(region).values())


EVENT_TABLES = (
    b"""# of a trial
quantity,index,measured,paper_numerical,unit
halting_time,1,0.351,0.3502,s
x1_extremum,1,-0.31,,m
drop_at_halt,1,27.1,26.9,cm
wrap_angle_at_halt,1,,2.5e2,deg
""",
    b"""quantity,index,value,sigma,unit
stop,1,0.3512,0.004,s
y1_extremum,2,31.0,0.1,cm
halting_time,1,351.2,4,ms
wrap_angle_at_halt,1,-,,rad
""",
    b"quantity;index;value;sigma;unit\nstop;1;0,3512;0,004;s\n",
)


def run_event_table(data: bytes) -> None:
    """Read an event table by both of its readers."""
    path = Path("any.csv")
    path.write_bytes(data)
    refused: list[HarnessError] = []
    try:
        for row in read_event_table(path):
            assert all(value is None or math.isfinite(value) for value in (row.measured, row.paper_numerical))
    except HarnessError as error:
        refused.append(error)
    try:
        for event in readers.read(path, kind="events").events:
            assert math.isfinite(event.value)
            assert 0 < event.sigma < math.inf
    except HarnessError as error:
        refused.append(error)
    if len(refused) == 2:
        raise refused[0]


def _table_seeds() -> list[bytes]:
    times = [k / 60 for k in range(8)]
    plain = [(t, 0.5 - t, -0.2 + t * t) for t in times]
    tracker_export = b",mass A,,mass B,,\nt,x,y,x,y,\n" + b"".join(
        b"%.6E,%.6E,%.6E,%.6E,%.6E,\n" % (t, x, y, -x, y - 0.1) for t, x, y in plain
    )
    tidy = b"t [s],light_x [cm],light_y [cm],heavy_y_m\n" + b"".join(b"%g,%g,%g,%g\n" % (*row, -row[1]) for row in plain)
    return [
        tracker_export,
        tracker_export.replace(b",", b";").replace(b".", b","),
        b"#multi:\n" + tracker_export.replace(b",", b"\t"),
        tidy,
        b"frame,x,y\n" + b"".join(b"%d,%g,%g\n" % (k, *row[1:]) for k, row in enumerate(plain)),
        b"".join(b"%g %g %g\n" % row for row in plain),
        b"t,angle [deg],rate\n" + b"".join(b"%g,%g,%g\n" % (t, 10 * t, 0.17) for t in times),
        b"frame,id,x,y,w,h\n"
        + b"".join(b"%d,%s,%g,%g,2,3\n" % (k, m, *row[1:]) for k, row in enumerate(plain) for m in (b"light", b"b")),
        b"frame,id,x1,y1,x2,y2\n"
        + b"".join(b"%d,1,%g,%g,%g,%g\n" % (k, x, y, x + 1, y + 1) for k, (_, x, y) in enumerate(plain)),
        b"".join(b"%d,%d,%g,%g,2,3,1,-1,-1,-1\n" % (k, n, *row[1:]) for k, row in enumerate(plain) for n in (1, 2)),
        b"t,light r,light theta,heavy r,heavy theta\n" + b"".join(b"%g,%g,%g,1,2\n" % row for row in plain),
        b"Frame,Time,light X,light Y,light Z\n" + b"".join(b"%d,%g,%g,-0.2,%g\n" % (k, *row) for k, row in enumerate(plain)),
        b"t,light_x [cm],light_y [cm]\n" + b"".join(b"%.4f,%.2f,03. Aug\n" % row[:2] for row in plain),
        b"drop,time,height [m]\n" + b"".join(b"%d,%g,%g\n" % (1 + k // 4, 0.1 * (k % 4), -k) for k, _ in enumerate(times)),
        b"\n".join((EXAMPLE / "trials" / "first.csv").read_bytes().split(b"\n")[:12]),
    ]


READER_OPTIONS: tuple[dict[str, object], ...] = (
    {},
    {"tracks": {"light": "mass A", "heavy": "mass B"}},
    {"tracks": {"light": ""}, "frame_rate": 240.0},
    {"tracks": {"light": "light"}, "frame_rate": 240.0, "clip_rate": 30.0, "units": {"length": "cm", "time": "ms"}},
    {"tracks": {"light": "1"}, "frame_rate": 240.0, "units": {"length": "mm", "angle": "deg"}, "box": "corner", "plane": "xz"},
    {"kind": "angle"},
    {"kind": "drop", "run": "1"},
)


def run_readers(data: bytes) -> None:
    """Read a table of marks in every way that a study may ask for; what is read is finite and in order."""
    path = Path("any.csv")
    path.write_bytes(data)
    refused: list[HarnessError] = []
    for options in READER_OPTIONS:
        try:
            observations = readers.read(path, **options)  # type: ignore[arg-type]
        except HarnessError as error:
            refused.append(error)
            continue
        assert observations.summary()
        for channel in observations.channels:
            assert np.isfinite(channel.value).all()
            assert np.all(np.diff(channel.t) > 0)
    if len(refused) == len(READER_OPTIONS):
        raise refused[0]


ENGINE = ReferenceEngine(Profile.QUICK)


@cache
def _scenario() -> Scenario:
    return replace(load("drop"), duration=0.03)


@cache
def small_result() -> ComparisonResult:
    """A small real result, of an engine that is the reference itself."""
    scenario = _scenario()
    run = replace(ENGINE.simulate(scenario), wall_time=0.01, cpu_time=0.01)  # the same bytes every time

    def reference(t: np.ndarray) -> Trajectory:
        rows = np.searchsorted(run.t, t[t <= run.t[-1] + 1e-9] - 1e-9)
        sampled = {f.name: value[rows] for f in fields(run) if isinstance(value := getattr(run, f.name), np.ndarray)}
        return replace(run, **sampled)

    return replace(compare(scenario, reference, [run]), run_keys=("key",))  # type: ignore[arg-type]


def _run_file_seeds() -> list[bytes]:
    import_module("scipy.interpolate")
    result = small_result()
    assert result.samples is not None
    folder = Path("stored")
    (folder / "trajectories").mkdir(parents=True, exist_ok=True)
    (folder / "result.json").write_text(result.to_json(), encoding="utf-8")
    reference = trajectory_csv(result.samples.reference)
    (folder / "trajectories" / "reference.csv").write_text(reference, encoding="utf-8")
    return [reference.encode()]


def run_run_file(data: bytes) -> None:
    """Read a run's file as `tracker` does, and as `demo` does, which runs the engines again where it cannot be read."""
    engine = small_result().engines[0]
    path = Path("stored") / "trajectories" / f"{file_stem(engine.label, engine.profile)}.csv"
    path.write_bytes(data)
    with mock.patch("looping_pendulum.compare.trajectories.run_key", return_value="key"):  # it takes 50 ms
        stored_result(Path("stored"), _scenario(), [ENGINE])
    _, rows = tracker.overlay(tracker.find_motion(str(path)), frame_rate=240.0)
    assert np.isfinite(rows).all()


def _baseline_seeds() -> list[bytes]:
    return [small_result().to_json().encode()]


def run_baseline(data: bytes) -> None:
    """Read an earlier result and list what changed since then."""
    path = Path("result.json")
    path.write_bytes(data)
    earlier = baseline.read_baseline(path, "drop")
    for changes in (baseline.changes_since(earlier, small_result()), baseline.changes_since(small_result(), earlier)):
        assert comparison_markdown(earlier, changes=changes).encode()
        assert changes.to_json().encode()


KINDS = {
    kind.name: kind
    for kind in (
        InputKind(name="units", seeds=_unit_seeds, run=run_quantity),
        InputKind(name="scenario", seeds=_scenario_seeds, run=run_scenario),
        InputKind(name="study", seeds=_study_seeds, run=run_study),
        InputKind(name="map", seeds=_map_seeds, run=run_map),
        InputKind(name="events", seeds=lambda: EVENT_TABLES, run=run_event_table),
        InputKind(name="readers", seeds=_table_seeds, run=run_readers),
        InputKind(name="run-file", seeds=_run_file_seeds, run=run_run_file),
        InputKind(name="baseline", seeds=_baseline_seeds, run=run_baseline),
        InputKind(name="command-line", seeds=command_lines.seeds, run=command_lines.run, inputs=command_lines.damaged_lines),
    )
}
"""Every kind by its name."""

"""Making a map: the same bytes however often it is interrupted, killed or damaged; and what stops it leaves the rest whole."""

import errno
import os
import shutil
import signal
import subprocess
from functools import cache, partial

import numpy as np
import pytest
import xarray as xr
import zarr.storage
from markdown_it import MarkdownIt

from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.batch import solve_batch
from looping_pendulum.sweep import cells, map_file, open_map, run_map
from looping_pendulum.sweep.cells import ENDINGS, FIELDS
from looping_pendulum.sweep.map_file import MapError
from tests.sweep import fake
from tests.sweep.maps import GRID, LONG, SAMPLE, chunk_files, contents, run

read = cache(map_file.load_text)
"""The plan of a map file's text; plans are frozen."""


def run_silently(plan, folder, **also):
    return run_map(plan, folder, **({"jobs": 1, "figures": False, "solve": fake.solve} | also))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An uninterrupted map of the fake solver, to compare with."""
    folder = tmp_path_factory.mktemp("whole")
    run_silently(read(GRID), folder)
    return contents(folder)


def test_what_a_map_is_called_is_no_markup_in_its_report(tmp_path):
    """A title with HTML reached map.md as it was."""
    title = "<script>alert(1)</script> ![x](http://evil)"
    text = GRID.replace("title: A grid", f"title: '{title}'\ndescription: '{title}'\n# ``` <b>\n\n\n\n## a comment")
    run_silently(map_file.load_text(text), tmp_path)
    report = (tmp_path / "map.md").read_text(encoding="utf-8")
    html = MarkdownIt("commonmark").enable("table").render(report)
    assert "<h1>&lt;script&gt;" in html
    for tag in ("<script", "<b>", 'evil"'):
        assert tag not in html
    assert text.strip() in report, "the map file is as it is"


def test_a_grid_says_what_the_batch_says(tmp_path):
    plan = map_file.load_text(GRID.replace("count: 6", "count: 4").replace("count: 12", "count: 3"))
    outcome = run_map(plan, tmp_path, jobs=1)
    assert outcome.complete
    angle, ratio = np.meshgrid(*(axis.values for axis in plan.axes), indexing="ij")
    batch = solve_batch(
        plan.scenario.parameters,
        {"release_angle": angle.ravel(), "heavy_mass": 0.01 * ratio.ravel()},
        duration=5.0,
        tolerance=1e-6,
    )
    with xr.open_zarr(tmp_path / "map.zarr") as data:
        assert data["halting_time"].dims == ("release_angle", "mass_ratio")
        for name, field in FIELDS.items():  # every bit: `solve_batch` promises that no result depends on what runs beside
            assert np.array_equal(data[name].values.ravel(), getattr(batch, name), equal_nan=field.kind is np.float64)
            assert data[name].attrs["long_name"] == field.meaning
        assert np.degrees(data["release_angle"].values) == pytest.approx(np.linspace(60, 130, 4))
        assert data["release_angle"].attrs["units"] == "rad"
        assert data.attrs["map_file"] == plan.text
        assert data.attrs["versions"]["numpy"] == np.__version__
    report = (tmp_path / "map.md").read_text()
    assert f"12 runs: {np.isfinite(batch.halting_time).sum()} (" in report
    assert (tmp_path / "halting_time.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
@pytest.mark.parametrize("key", ["free_length", "release.free_length"])
@pytest.mark.parametrize("design", ["", "sample: {count: 4}"])
def test_a_varied_free_length_stands_beside_the_one_at_the_end(tmp_path, key, design):
    """Both arrays were `free_length`, so that Zarr ended with its ContainsArrayError."""
    values = "{from: 0.4 m, to: 0.6 m" + ("}" if design else ", count: 4}")
    plan = map_file.load_text(f"title: L\nscenario: ten_to_one\nparameters:\n  {key}: {values}\ntolerance: 1e-6\n{design}")
    run_map(plan, tmp_path, jobs=1)
    # A second time, since a store that is there is compared with the map's own
    assert run_map(plan, tmp_path, jobs=1).complete
    data = open_map(tmp_path)
    lengths = data["release_free_length"].values
    assert (lengths.min() >= 0.4, lengths.max() <= 0.6, len(np.unique(lengths))) == (True, True, 4)
    batch = solve_batch(plan.scenario.parameters, {"free_length": lengths}, duration=5.0, tolerance=1e-6)
    assert np.array_equal(data["free_length"].values, batch.free_length, equal_nan=True)
    assert "release_free_length" in (tmp_path / "map.md").read_text()
    assert (tmp_path / "halting_time.png").exists()


@pytest.mark.long
def test_a_sample_has_its_parameters_beside_its_results(tmp_path):
    plan = read(SAMPLE)
    run_silently(plan, tmp_path, figures=True)
    data = open_map(tmp_path)
    expected = plan.values_in((slice(0, 100),))
    assert set(data.coords) == {"release_angle", "rod_radius"}
    assert data["drop"].dims == ("run",)
    for name, values in expected.items():
        assert np.array_equal(data[name].values, values)
    assert (tmp_path / "halting_time.png").exists()


@pytest.mark.long
def test_killed_at_any_moment_it_goes_on_to_the_same_bytes(tmp_path, whole):
    """Before its first chunk, and in the middle of one: as soon as some of the files of its fields are there."""
    (tmp_path / "map.yaml").write_text(GRID)
    folder, moments = tmp_path / "out", (0, 3, 17, 28, 39)
    again = (tmp_path / "map.yaml", folder) * (len(moments) + 1)
    done = run("tests.sweep.fake", *again, "--killed-at", *moments)
    *kept, result, files = done.stdout.splitlines()
    assert tuple(map(int, kept)) == moments, done.stderr
    assert result.startswith("72 ")
    assert int(files) > moments[-1]
    assert contents(folder) == {**whole, "map.yaml": GRID.encode()}


def test_what_a_killed_process_may_leave_is_made_good(tmp_path, whole):
    """A half-written file under its temporary name, a chunk without its last field, and a cut and a flipped one."""
    plan = read(GRID)
    (tmp_path / "map.zarr").mkdir(parents=True)
    run_silently(plan, tmp_path)
    store = tmp_path / "map.zarr"
    (store / "drop" / "c" / "1" / "0.0123456789abcdef.partial").write_bytes(b"half")
    for name in ("end", "stops"):
        (store / name / "c" / "2" / "0").unlink()
    cut = store / "drop" / "c" / "3" / "0"
    cut.write_bytes(cut.read_bytes()[:-3])
    flip(store / "end_time" / "c" / "4" / "0", 300)
    outcome = run_silently(plan, tmp_path)
    assert (outcome.runs_before, outcome.runs_now) == (72 - 3 * 12, 72)
    assert contents(tmp_path) == whole


def flip(path, bit):
    data = bytearray(path.read_bytes())
    data[bit // 8] ^= 1 << bit % 8
    path.write_bytes(data)


@pytest.mark.long
def test_a_coordinate_that_is_lost_or_damaged_is_noticed_when_read_and_restored_when_resumed(tmp_path, whole):
    """Coordinates had no checksum: of 53 flipped bits 18 changed values, and without its chunk one was read as zeros."""
    plan = read(GRID)
    run_silently(plan, tmp_path)
    chunk = tmp_path / "map.zarr" / "release_angle" / "c" / "0"
    size = 8 * len(chunk.read_bytes())
    for harm in (chunk.unlink, *(partial(flip, chunk, bit) for bit in range(0, size, size // 4))):
        harm()
        with pytest.raises(MapError, match="^[^\n]*map.zarr: found it damaged"):
            open_map(tmp_path)
        outcome = run_silently(plan, tmp_path)
        assert (outcome.runs_before, outcome.runs_now) == (72, 72)
        assert contents(tmp_path) == whole
    assert np.allclose(open_map(tmp_path)["release_angle"], np.radians(np.linspace(60, 130, 6)), rtol=1e-15)


BROKEN = (lambda good: good[:-20], lambda good: b"", lambda good: b"[]", lambda good: b"[" * 10**5, lambda good: b"\xff" + good)
"""Ways in which a JSON file is damaged so that it cannot be read."""


@pytest.mark.parametrize("file", ["drop/zarr.json", pytest.param("mass_ratio/zarr.json", marks=pytest.mark.accurate)])
def test_a_damaged_description_of_an_array_is_restored(tmp_path, whole, file):
    """It ended in a bare JSONDecodeError; a digit in it that is another one changed what was read."""
    plan = read(GRID)
    run_silently(plan, tmp_path)
    path = tmp_path / "map.zarr" / file
    good = path.read_bytes()
    for bad in (*(harm(good) for harm in BROKEN), good.replace(b"12", b"13"), good.replace(b'"units"', b'"limits"')):
        assert bad != good
        path.write_bytes(bad)
        assert run_silently(plan, tmp_path).runs_before == 72
        assert contents(tmp_path) == whole


def test_a_map_whose_own_description_is_damaged_is_refused_in_one_line(tmp_path, whole):
    """It says which map it is, and without it another could be mixed with this one."""
    plan = read(GRID)
    run_silently(plan, tmp_path)
    path = tmp_path / "map.zarr" / "zarr.json"
    good = path.read_bytes()
    for harm in BROKEN:
        path.write_bytes(harm(good))
        with pytest.raises(MapError, match=r"^[^\n]*found (something that is no|another) map[^\n]*$"):
            run_silently(plan, tmp_path)
    path.unlink()
    with pytest.raises(MapError, match="found other files"):
        run_silently(plan, tmp_path)
    path.write_bytes(good)
    assert run_silently(plan, tmp_path).runs_before == 72
    assert contents(tmp_path) == whole


@pytest.mark.long
def test_chunks_without_a_halt_are_done_too(tmp_path):
    plan = read(GRID)

    def never(plan, region, **limits):
        values = fake.solve(plan, region)
        for name, field in FIELDS.items():
            values[name][:] = ENDINGS.index("failed") if name == "end" else field.missing
        return values

    run_silently(plan, tmp_path, solve=never)
    assert run_silently(plan, tmp_path, solve=never).runs_before == 72


def test_ctrl_c_keeps_what_is_done_and_the_same_call_goes_on(tmp_path, whole):
    def interrupt(done, runs):
        if done == 48:
            raise KeyboardInterrupt

    plan = read(GRID)
    outcome = run_silently(plan, tmp_path, progress=interrupt)
    assert outcome.interrupted
    assert (outcome.runs_now, outcome.complete) == (48, False)
    data = open_map(tmp_path)
    assert int((data["end"] == -1).sum()) == 72 - 48
    assert run_silently(plan, tmp_path).runs_before == 48
    assert contents(tmp_path) == whole


@pytest.mark.long
def test_memory_does_not_grow_with_the_map(tmp_path):
    """25 chunks of runs instead of one; kept, their results alone would take 7.4 MB.

    Few and large chunks: each writes some twenty files, which takes longer than the fake solver does.

    Each map has a forked process of its own: one that is started anew counts what its parent held as its own peak.
    """
    pairs, large = [], GRID.replace("count: 6", "count: 100").replace("chunk: 12", "chunk: 4000")
    for count in (40, 1000):
        path = tmp_path / f"{count}.yaml"
        path.write_text(large.replace("count: 12", f"count: {count}"))
        pairs += [path, tmp_path / f"out{count}"]
    done = run("tests.sweep.fake", *pairs)
    (few, before), (many, after) = (map(int, line.split()) for line in done.stdout.splitlines()[::2])
    assert (few, many) == (4000, 100_000), done.stderr
    assert after - before < 4000  # KiB; measured 1100 to 1600, and 8800 to 9100 if results are kept


def test_a_full_disk_is_one_line_and_leaves_the_rest_whole(tmp_path, whole, monkeypatch):
    plan, written = read(GRID), []
    put = zarr.storage.LocalStore.set

    async def full(self, key, value, *also, **more):
        written.append(key)
        if len(written) == 60:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), key)
        return await put(self, key, value, *also, **more)

    monkeypatch.setattr(zarr.storage.LocalStore, "set", full)
    with pytest.raises(MapError, match="found a full disk .*what is finished is kept: free some.*same command again") as caught:
        run_silently(plan, tmp_path)
    assert "\n" not in str(caught.value)
    assert 0 < len(chunk_files(tmp_path)) < 6
    assert run_silently(plan, tmp_path).runs_before > 0
    assert contents(tmp_path) == whole


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    plan = read(GRID)
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(MapError, match=r"found other files \(thesis.tex\), needed an empty folder.*--out"):
        run_silently(plan, tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "precious"
    assert not (tmp_path / "map.zarr").exists()


def test_another_map_is_left_alone(tmp_path, whole):
    run_silently(read(GRID), tmp_path)
    for other in (GRID.replace("1e-6", "1e-7"), GRID.replace("count: 12", "count: 13"), SAMPLE):
        with pytest.raises(MapError, match=r"found another map \('A grid', .*needed the map of map.yaml; choose another"):
            run_silently(map_file.load_text(other), tmp_path)
    assert contents(tmp_path) == whole
    commented = map_file.load_text(GRID + "# a comment decides nothing\n")
    assert run_silently(commented, tmp_path).runs_before == 72


def test_a_map_of_other_versions_is_not_mixed(tmp_path):
    plan = read(GRID)
    run_silently(plan, tmp_path)
    group = zarr.open_group(tmp_path / "map.zarr", mode="r+", use_consolidated=False)
    group.attrs["versions"] = {**group.attrs["versions"], "numpy": "1.0"}
    with pytest.raises(MapError, match=r"begun with numpy 1\.0, and here is .*install numpy 1\.0, or choose another folder"):
        run_silently(plan, tmp_path)


def test_two_at_once_in_one_folder(tmp_path):
    plan = read(GRID)

    def second(plan, region, **limits):
        with pytest.raises(MapError, match="found another run that is writing here"):
            run_silently(plan, tmp_path)
        return fake.solve(plan, region)

    assert run_silently(plan, tmp_path, solve=second).complete


def test_a_folder_may_have_the_name_of_an_address(tmp_path):
    """zarr took "zip::x" for a chained URL: the figure was left out, and the map was found damaged."""
    folder = tmp_path / "zip::x"
    assert run_silently(read(GRID), folder, figures=True).complete
    assert open_map(folder)["end"].size == 72
    assert (folder / "halting_time.png").exists()


@pytest.mark.long
def test_engines_may_be_mapped_too(tmp_path):
    text = "title: E\nscenario: ten_to_one\nengine: [reference, mujoco:capstan]\nparameters:\n  mass_ratio: [9, 10]\n"
    plan = map_file.load_text(text + "duration: 1.5 s\n")
    run_map(plan, tmp_path, jobs=1)
    data = open_map(tmp_path)
    assert data["halting_time"].dims == ("engine", "mass_ratio")
    assert list(data["engine"].values) == ["reference", "mujoco:capstan"]
    reference, engine = data["halting_time"].values
    assert np.all(np.abs(engine - reference) < 8e-3)  # the scenarios' own limit for an engine's halt
    assert "How runs ended: mujoco:capstan" in (tmp_path / "map.md").read_text()


def test_a_disk_that_is_really_full(tmp_path, whole):
    plan, small = read(GRID), tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=300k", "none", str(small)]
    if os.geteuid() != 0 or shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("only root may mount a small disk")
    try:
        with pytest.raises(MapError, match="found a full disk"):
            run_silently(plan, small / "out")
        assert len(chunk_files(small / "out")) > 0
        subprocess.run(["mount", "-o", "remount,size=64m", str(small)], check=True)
        assert run_silently(plan, small / "out").runs_before > 0
        assert contents(small / "out") == whole
    finally:
        subprocess.run(["umount", str(small)], check=True)


@pytest.mark.long
def test_threads_change_no_byte_even_if_one_fails(tmp_path, whole):
    def fail_late(plan, region, **limits):
        if region[0].start == 5:
            raise EngineError("an engine broke")
        return fake.solve(plan, region)

    plan = read(GRID)
    with pytest.raises(EngineError, match="an engine broke"):
        run_silently(plan, tmp_path, jobs=2, solve=fail_late)
    assert run_silently(plan, tmp_path, jobs=2).complete
    assert contents(tmp_path) == whole


@pytest.mark.long
def test_ctrl_c_ends_the_threads_in_the_middle_of_their_chunks(tmp_path):
    def interrupt(signum, frame):
        raise KeyboardInterrupt

    plan = read(LONG.replace("1e-6", "1e-12").replace("count: 12", "count: 400000").replace("chunk: 12", "chunk: 400000"))

    def solve(*given, **limits):
        signal.setitimer(signal.ITIMER_REAL, 0.5)  # not before a chunk has begun, as until then nothing waits for Ctrl-C
        ended.append(cells.solve_chunk(*given, **limits))
        return ended[-1]

    ended = []
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        outcome = run_map(plan, tmp_path, jobs=2, solve=solve)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert outcome.interrupted
    assert ended == []  # one chunk takes 10 s or more

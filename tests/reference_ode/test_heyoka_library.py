"""heyoka's cache of compiled code is limited, in our folder, and never a reason to fail; its import does not import SymPy."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import looping_pendulum
from looping_pendulum.reference_ode import heyoka_library
from looping_pendulum.reference_ode.effects.own import OwnEffect, effect_of
from looping_pendulum.reference_ode.heyoka_library import DISK_LIMIT

pytest.importorskip("heyoka", reason="this is about heyoka's own files")

COMPILE = """
import sys
from looping_pendulum.reference_ode.heyoka_library import load_heyoka
hy = load_heyoka()
x = hy.expression("x")
assert hy.cfunc([hy.sin(x)], [x])([0.0]) == [0.0]
code = hy.llvm_state
assert "sympy" not in sys.modules
print(code.get_diskcache_enabled(), code.get_diskcache_path())
print(code.get_diskcache_limit() if code.get_diskcache_enabled() else None)
"""
FILL = """
from looping_pendulum.reference_ode import heyoka_library
heyoka_library.DISK_LIMIT = {limit}
hy = heyoka_library.load_heyoka()
x, v = hy.make_vars("x", "v")
for i in range(6):
    hy.cfunc([hy.sin(x * float({first} + i)) + v], [x, v])
"""


def start(code: str, cache: Path, **variables: str) -> subprocess.Popen[str]:
    environment = {name: value for name, value in os.environ.items() if name != "HEYOKA_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(cache)} | variables
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", code], stdout=pipe, stderr=pipe, text=True, env=environment)


def printed(process: subprocess.Popen[str]) -> list[str]:
    out, error = process.communicate(timeout=120)
    assert (process.returncode, error) == (0, "")
    return out.split()


def test_nothing_else_imports_heyoka():
    package = Path(looping_pendulum.__file__).parent
    importing = [
        path.name for path in package.rglob("*.py") if re.search(r"^\s*(import|from) heyoka", path.read_text(), re.MULTILINE)
    ]
    assert importing == ["heyoka_library.py"]


@pytest.mark.long
def test_compiled_code_is_kept_in_our_folder_under_our_limit(tmp_path):
    folder = tmp_path / "looping-pendulum" / "heyoka"
    assert printed(start(COMPILE, tmp_path)) == ["True", str(folder), str(DISK_LIMIT)]
    assert (folder / "cache.db").stat().st_size > 0


def test_who_chooses_a_folder_keeps_it_and_its_limit(tmp_path):
    chosen = tmp_path / "chosen"
    enabled, path, limit = printed(start(COMPILE, tmp_path, HEYOKA_CACHE_DIR=str(chosen)))
    assert (enabled, path) == ("True", str(chosen))
    assert int(limit) > DISK_LIMIT
    assert not (tmp_path / "looping-pendulum").exists()


@pytest.mark.parametrize("damage", ["a file where the folder should be", "a file that is no database"])
def test_a_folder_that_cannot_be_used_costs_time_alone(tmp_path, damage):
    folder = tmp_path / "looping-pendulum" / "heyoka"
    if "folder" in damage:
        folder.parent.mkdir()
        folder.write_text("")
    else:
        folder.mkdir(parents=True)
        (folder / "cache.db").write_bytes(b"no database" * 1000)
    assert printed(start(COMPILE, tmp_path)) == ["False", str(folder), "None"]


@pytest.mark.long
def test_two_processes_that_fill_one_folder_keep_to_the_limit(tmp_path):
    limit = 200_000  # bytes: each of the functions takes some tens of thousands
    processes = [start(FILL.format(limit=limit, first=first), tmp_path) for first in (1, 100)]
    assert [printed(process) for process in processes] == [[], []]
    kept = (tmp_path / "looping-pendulum" / "heyoka" / "cache.db").stat().st_size
    assert limit / 2 < kept < 2 * limit  # the file's own pages and index stand beside what the limit counts


RUN = """
import sys
import numpy as np
from looping_pendulum.reference_ode import batch, heyoka_backend
from looping_pendulum.reference_ode.batch import compiled, steps
from looping_pendulum.reference_ode.heyoka_library import COMPILER_OPTIONS
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve_at
{before}
made = []
for module, name in ((heyoka_backend, "_integrator"), (steps, "_terms"), (compiled, "Symbols")):
    def counted(*a, _made=getattr(module, name), **k):
        made.append(1)
        return _made(*a, **k)
    setattr(module, name, counted)
p = Parameters(light_mass=0.01, heavy_mass=0.1, rod_radius=0.006, free_length=0.5, release_angle=1.5)
held = p.replace(release="held", release_angle=2.5)
t = np.linspace(0.0, 1.0, 9)
states = [solve_at(one, t, tolerance=1e-6).state.wrap_angle for one in (p, held)]
states.append(batch.sample_batch(p, {{"heavy_mass": np.array([0.1, 0.11])}}, [t, t], tolerance=1e-6).state[1])
print(len(made) > 0, *np.concatenate(states).tolist())
"""


def kept(cache: Path) -> list[Path]:
    return sorted((cache / "looping-pendulum" / "heyoka").glob("*.pickle"))


@pytest.mark.long
def test_what_was_compiled_is_read_and_not_made_again(tmp_path):
    """Oracle: the same bits as from what was just compiled, a swing past its turning points included."""
    made, *first = printed(start(RUN.format(before=""), tmp_path))
    again, *second = printed(start(RUN.format(before=""), tmp_path))
    assert (made, again) == ("True", "False")
    assert first == second


@pytest.mark.long
def test_damaged_files_and_other_options_cost_time_alone(tmp_path):
    _, *first = printed(start(RUN.format(before=""), tmp_path))
    files = kept(tmp_path)
    for file in files:
        file.write_bytes(file.read_bytes()[:100])
    made, *second = printed(start(RUN.format(before=""), tmp_path))
    assert (made, second) == ("True", first)
    made, *_ = printed(start(RUN.format(before="COMPILER_OPTIONS['opt_level'] = 0"), tmp_path))
    assert made == "True"
    assert len(kept(tmp_path)) > len(files)


def test_the_least_recently_used_files_go_beyond_the_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(heyoka_library, "PICKLED_LIMIT", 250)
    monkeypatch.setenv("HEYOKA_CACHE_DIR", str(tmp_path))
    for i, name in enumerate("abc"):
        heyoka_library._keep(tmp_path / f"{name}.pickle", b"x" * 100)
        os.utime(tmp_path / f"{name}.pickle", (i, i))
    heyoka_library._keep(tmp_path / "d.pickle", b"x" * 100)
    assert {path.stem for path in tmp_path.glob("*.pickle")} == {"c", "d"}


def test_an_effect_from_elsewhere_is_made_anew(tmp_path, monkeypatch):
    """Its name does not say what it is."""
    monkeypatch.setenv("HEYOKA_CACHE_DIR", str(tmp_path))
    own = effect_of(OwnEffect(name="magnet", unit="N", bounds=(-1.0, 1.0), force=(("light_vertical", "magnet"),)))
    made = []
    for _ in range(2):
        heyoka_library.compiled(("x",), (own,), lambda: made.append(1))
        heyoka_library.compiled(("x",), (), lambda: made.append(2))
    assert made == [1, 2, 1]
    assert len(list(tmp_path.glob("*.pickle"))) == 1

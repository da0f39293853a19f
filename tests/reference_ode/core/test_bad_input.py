"""What cannot be carried out ends in one sentence that says so, and leaves the driver fit for the next run."""

import math
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import wasmtime

from looping_pendulum.errors import IntegrationError, ParameterError
from looping_pendulum.reference_ode.batch import ENDS, solve_batch
from looping_pendulum.reference_ode.core.host import Core, this_threads_core, traced
from looping_pendulum.reference_ode.effects.own import OwnEffect
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve, solve_at
from tests.apparatus import TEN_TO_ONE

T = np.linspace(0.0, 1.0, 20)
ENDLESS = "k * sin(1000000000 * time)"


@pytest.fixture(autouse=True)
def _the_driver_is_fit_afterwards():
    before = solve_at(TEN_TO_ONE, T)
    yield
    assert np.array_equal(np.array(solve_at(TEN_TO_ONE, T).state), np.array(before.state))


def pulled_by(formula: str) -> Parameters:
    """Return an apparatus with a force on the light mass along its string."""
    own = OwnEffect(name="k", unit="N", bounds=(-1.0, 1.0), force=(("light_along_string", formula),))
    return Parameters(**{**TEN_TO_ONE.as_dict(), "own_effects": (own,)}).replace(k=0.01)


@pytest.mark.parametrize(
    ("formula", "fault"),
    [
        ("k / (time - 0.1)", "the integration broke down, at t = 0.1 s, "),  # it divides by zero during the run
        ("k / (wrap_angle - 3)", r"the integration broke down, at t = 0\.\d+ s, .* wrap_angle 3, "),
        ("k * exp(1000 * free_length)", "the integration broke down"),  # beyond the largest double
        (ENDLESS, "more than 200000 steps in one mode, at t = "),
    ],
)
def test_a_formula_that_cannot_be_integrated_says_where(formula, fault):
    parameters = pulled_by(formula)
    with pytest.raises(IntegrationError, match=fault) as error:
        solve_at(parameters, T)
    assert str(error.value).endswith("; check the parameters")
    # Among other runs it alone fails
    absent_and_weak = solve_batch(parameters, {"k": np.array([0.0, 0.01])}, duration=0.5)
    assert [ENDS[end] == "failed" for end in absent_and_weak.end] == [False, True]
    with pytest.raises(IntegrationError) as error:
        solve_at(parameters, [], duration=0.5)
    assert {run: str(why) for run, why in absent_and_weak.errors.items()} == {1: str(error.value)}


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"duration": math.nan}, "duration: found nan s, needed 0 or more"),
        ({"duration": -1.0}, "duration: found -1 s, needed 0 or more"),
        ({"tolerance": math.nan}, "tolerance: found nan, needed a number above 0, such as 1e-9"),
        ({"tolerance": 0.0}, "tolerance: found 0, needed a number above 0, such as 1e-9"),
    ],
)
def test_limits_that_are_no_numbers_are_refused(given, fault):
    for call in (solve, partial(solve_at, t=T), partial(solve_batch, columns={"light_mass": np.full(2, 0.02)})):
        with pytest.raises(ParameterError) as error:
            call(TEN_TO_ONE, **given)
        assert str(error.value) == fault


def test_a_parameter_that_is_no_number_is_refused_and_fails_alone_among_others():
    with pytest.raises(ParameterError, match="^kinetic_friction: found nan"):
        TEN_TO_ONE.replace(kinetic_friction=math.nan)
    batch = solve_batch(TEN_TO_ONE, {"kinetic_friction": np.array([0.2, math.nan])}, duration=0.2)
    assert [ENDS[end] == "failed" for end in batch.end] == [False, True]
    assert {run: str(error) for run, error in batch.errors.items()} == {
        1: "kinetic_friction: found nan, needed between 0 and 5"
    }


def test_times_that_descend_are_refused():
    with pytest.raises(ParameterError, match="found times that descend, needed ascending ones"):
        solve_at(TEN_TO_ONE, T[::-1])


@pytest.mark.parametrize("samples", [38_300_000, 60_000_000])
def test_results_for_which_there_is_no_memory_are_refused(samples):
    """A sample with its time takes 112 B, and memory ends at 4.295e9 B: the second length would wrap around."""
    model = traced(TEN_TO_ONE.release, TEN_TO_ONE.effects, False)
    p = np.array([[getattr(TEN_TO_ONE.values(), name) for name in model.names]])
    times = np.broadcast_to(0.5, (samples,))  # without memory of its own
    with pytest.raises(IntegrationError, match="found no memory for their results; ask for fewer samples"):
        this_threads_core().carry_out(model, p, np.ones(1), times, np.array([0, samples], dtype=np.int32), tolerance=1e-9)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no timer that interrupts")
def test_an_endless_run_is_interrupted_within_a_fifth_of_a_second():
    """Of processor time, as other programs may hold this one up."""
    heard_after = []

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    parameters, handler = pulled_by(ENDLESS), signal.signal(signal.SIGPROF, interrupt)
    try:
        for _ in range(3):
            due = time.process_time() + 0.1
            signal.setitimer(signal.ITIMER_PROF, 0.1)
            with pytest.raises(KeyboardInterrupt):
                solve_batch(parameters, {"k": np.full(50, 0.01)})
            heard_after.append(time.process_time() - due)
    finally:
        signal.signal(signal.SIGPROF, handler)
    assert max(heard_after) < 0.2


def test_a_system_without_a_wheel_of_wasmtime_is_told_so(tmp_path):
    """Where there is no wheel pip takes the one for any system, whose import fails with such an error."""
    (tmp_path / "wasmtime").mkdir()
    (tmp_path / "wasmtime" / "__init__.py").write_text('raise RuntimeError("unsupported architecture for wasmtime: riscv64")\n')
    ended = subprocess.run(
        [sys.executable, "-m", "looping_pendulum", "check", "atwood"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert ended.stderr == (
        "error: wasmtime does not run on this system (unsupported architecture for wasmtime: riscv64); "
        "it has wheels for Linux, macOS and Windows with a 64-bit Python: see docs/install.md\n"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits addresses")
def test_four_gigabytes_of_addresses_are_enough():
    """wasmtime reserves 4.3 GB for each thread where it can; the same bits come without them."""
    program = (
        "import sys, numpy as np, looping_pendulum as lp\n"
        "if sys.argv[1:]: import resource; resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2)\n"
        "s = lp.load('ten_to_one'); print(lp.solve(s).end)\n"
        "print(lp.solve_batch(s, {'kinetic_friction': np.linspace(0.1, 0.4, 600)}, threads=2).sequence)"
    )

    def output(*limit: str) -> str:
        done = subprocess.run([sys.executable, "-c", program, *limit], capture_output=True, text=True, check=True)
        return done.stdout

    assert output("4000000000") == output()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other folders of caches")
@pytest.mark.parametrize("damage", [None, b"", b"not compiled"], ids=["whole", "empty", "other bytes"])
def test_compiled_models_are_kept_in_the_folder_of_caches(tmp_path, damage):
    program = "import looping_pendulum as lp; print(lp.solve(lp.load('ten_to_one')).end)"

    def output(folder: Path) -> str:
        environment = os.environ | {"XDG_CACHE_HOME": str(folder)}
        command = [sys.executable, "-c", program]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    assert output(tmp_path) == output(Path("/proc/none"))  # where nothing can be written, nothing is kept
    kept = {file for file in tmp_path.rglob("modules/*/*") if not file.suffix}
    assert kept
    for file in kept if damage is not None else ():
        file.write_bytes(damage)
    assert output(tmp_path) == output(Path("/proc/none"))
    assert {file for file in tmp_path.rglob("modules/*/*") if not file.suffix} == kept


def test_what_wasmtime_cannot_do_is_one_sentence(monkeypatch):
    def refuse(*_: object) -> None:
        raise wasmtime.WasmtimeError("mmap failed to reserve 0x10000 bytes\n\nCaused by:\n    Cannot allocate memory\n")

    monkeypatch.setattr(wasmtime, "Instance", refuse)
    with pytest.raises(IntegrationError) as error:
        Core()
    assert str(error.value) == (
        "wasmtime, which carries out runs, failed (mmap failed to reserve 0x10000 bytes Caused by: Cannot allocate memory); "
        "where memory is limited, allow more, or use fewer threads"
    )


def test_the_memory_of_many_samples_is_given_back():
    """Oracle: the system's count of this process's memory; 4 million samples take 448 MB in the driver."""
    program = (
        "import numpy as np, psutil, looping_pendulum as lp; p = lp.load('ten_to_one').parameters\n"
        "def held(): lp.solve_at(p, np.zeros(1)); return psutil.Process().memory_info().rss\n"
        "before = held(); lp.solve_at(p, np.linspace(0, 0.1, 4_000_000)); print(held() - before)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 100e6

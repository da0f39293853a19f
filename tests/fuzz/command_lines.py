"""Command lines, run in this process by the program's own `main`, up to where the work would begin."""

import contextlib
import io
import os
import shutil
import sys
import warnings
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest import mock

import typer
from hypothesis import strategies as st

from looping_pendulum.cli import main as cli
from looping_pendulum.compare.trajectories import CSV_HEADER
from looping_pendulum.errors import HarnessError
from tests.fuzz.damage import Draw, words

SEPARATOR = b"\0"
"""Between arguments; no argument can hold it."""
EXAMPLE = Path(__file__).parents[2] / "looping_pendulum" / "teaching" / "example"

WORK = (
    "looping_pendulum.engines.isolation.run_all",
    "looping_pendulum.compare.harness.compare_engines",
    "looping_pendulum.compare.convergence.study.study_convergence",
    "looping_pendulum.engines.conformance.run_checks",
    "looping_pendulum.sweep.runner.run_map",
    "looping_pendulum.discrepancy.identify.identify",
    "looping_pendulum.demonstrations.runner.run_demonstration",
    "looping_pendulum.teaching.tracker.run_isolated",
    "looping_pendulum.discrepancy.inputs.read_inputs",
)
"""Where work begins; a command line that gets there was accepted."""

SEED_LINES = (
    "scenarios", "scenarios ten_to_one", "scenarios mine.yaml", "scenarios --schema", "engines", "engines --support --markdown",
    "run two_to_one --out runs", "run mine.yaml -e mujoco:capstan -p accurate --jobs 2 --time-limit 30 --memory-limit 1GiB",
    "compare ten_to_one -e pymunk -e mujoco --profile quick --out report",
    "compare drop --baseline result.json --baseline-threshold 0.1",
    "compare mine.yaml --data trials --jobs 1", "check", "check mine.yaml ten_to_one -e mujoco",
    "conformance pymunk:chain --time-limit 5",
    "converge ten_to_one --engine mujoco:capstan --time-limit 60 --until 0.7", "map quick --out m --max-runs 1000 --jobs 2",
    "map map.yaml",
    "map", "map quick --print", "map map.yaml --print", "identify study.yaml --seed 1 --out report",
    "demo two_to_one --no-open --again",
    "new scenario own.yaml --like two_to_one --light-mass 12g", "new study trials/first.csv --out s.yaml --free-length 58cm",
    "init fresh", "tracker runs.csv --fps 240 --start 0.35 --out o.csv", "tracker ten_to_one -e pymunk:chain", "tracker full",
    "demonstrations --list", "demonstrations polygon --out d", "--help", "run --help", "--version",
    "map quick --cluster nonsense",
)  # fmt: skip
VALUES = (
    "ten_to_one", "ten_to_on", "mine.yaml", "bad.yaml", "study.yaml", "map.yaml", "trials/first.csv", "latin.csv", "back.csv",
    "runs.csv",
    "empty", "full", "nope", "nope.csv", "nope.yaml", "result.json", "deep.json", "999999999", "0", "-1", "1e300", "nan", "inf",
    "quick",
    "accurate", "pymunk", "mujoco:", ":", "mujoco:capstan", "reference", "reference:", "pymnk", "2 GiB", "9**9**9 B", "2",
    "1 MiB",
    "nonsense", "tcp://", "tcp://127.0.0.1:0", "light.mass=12 g", "light.mass=nan kg", "=", "a=b", "title=", "title=\x1b[31m",
    "trials.1.file=nope.csv", "effects=capstan, nothing", "count=0", "count=21", "scenario", "study", "polygon", "--", "-", "",
    "full/taken", "x" * 300, "[/x]", "\u202etxt.exe", "\x1b[2J", "a\nb", "\udcff.yaml", "/dev/null", "/dev/full", "/nope/x",
)  # fmt: skip


class RefusedLine(HarnessError):
    """A command line was refused as it should be: one clear line, exit status 2."""


class NotInOrder(AssertionError):
    """A command line did not end as every one must."""


def encoded(arguments: Sequence[str]) -> bytes:
    """Bytes of the arguments."""
    return SEPARATOR.join(os.fsencode(argument.replace("\0", "")) for argument in arguments)


def seeds() -> list[bytes]:
    """Real command lines, and the files that they name, in a folder from which each run starts anew."""
    for module in (work.rpartition(".")[0] for work in WORK):
        import_module(module)  # takes longer than any command line may
    shutil.rmtree("pristine", ignore_errors=True)
    here = Path("pristine")
    shutil.copytree(EXAMPLE, here)
    for trial in (here / "trials").glob("*.csv"):
        trial.write_bytes(b"\n".join(trial.read_bytes().split(b"\n")[:12]) + b"\n")
    (here / "mine.scenario.yaml").rename(here / "mine.yaml")
    (here / "bad.yaml").write_text("title: [/x]\nlight: {mass: 1 nan}\n")
    (here / "map.yaml").write_text(
        "title: m\nscenario: mine.yaml\nparameters: {release_angle: {from: 60 deg, to: 90 deg, count: 3}}\n"
    )
    (here / "latin.csv").write_bytes(b"t,x,y\n0,1,\xfc\n")
    head = ",".join(CSV_HEADER) + "\n"
    rows = ["0,0,0,0,0,1,0,0,0,,,,,,,\n", "0.1,0,0,0,0,1,0,0,0,,,,,,,\n"]
    (here / "runs.csv").write_text(head + "".join(rows))
    (here / "back.csv").write_text(head + "".join(reversed(rows)))
    (here / "result.json").write_text("{}")
    (here / "deep.json").write_text("[" * 100_000)
    (here / "empty").mkdir()
    (here / "full").mkdir()
    (here / "full" / "taken").write_text("a file")
    return [encoded(line.split()) for line in SEED_LINES]


@cache
def _command() -> Any:
    """Return the program's commands; typer makes them anew at every start."""
    return typer.main.get_command(cli.app)


@cache
def _options() -> dict[str, list[str]]:
    """Command -> its options."""
    commands = _command().commands
    return {name: [o for p in command.params for o in p.opts if o.startswith("-")] for name, command in commands.items()}


@st.composite
def damaged_lines(draw: Draw, seeds: Sequence[bytes]) -> bytes:
    """Return a command line with other, fewer or more arguments."""
    parts = draw(st.sampled_from(seeds)).split(SEPARATOR)
    # The system takes no longer argument, and none with a zero byte
    values = st.sampled_from(VALUES).map(os.fsencode) | words().map(lambda word: word.replace(SEPARATOR, b"")[:100_000])
    for how in draw(st.lists(st.sampled_from(("replace", "option", "leave out", "exchange")), min_size=1, max_size=4)):
        i, j = (draw(st.integers(0, max(0, len(parts) - 1))) for _ in range(2))
        if how == "option" or not parts:
            known = _options().get(os.fsdecode(parts[0]) if parts else "") or ["--help", "--version", "--debugg", "-x"]
            parts += [draw(st.sampled_from(known)).encode(), draw(values)]
        elif how == "replace":
            parts[i] = draw(values)
        elif how == "leave out":
            del parts[i]
        else:
            parts[i], parts[j] = parts[j], parts[i]
    return SEPARATOR.join(parts)


def arguments_of(data: bytes) -> list[str]:
    """Arguments of an input; none leads out of the folder, since commands make folders and files."""
    parts = [os.fsdecode(part) for part in data.split(SEPARATOR) if data]
    kept = {"/dev/null", "/dev/full"}
    return [
        part if part in kept else part.replace("=/", "=").lstrip("/").replace("..", ".") for part in parts if part != "--debug"
    ]


def run(data: bytes) -> None:
    """Run a command line up to its work.

    Raises
    ------
    RefusedLine
        If it ended as a refused one must.
    NotInOrder
        If it ended otherwise, without an exception that says so itself.
    """
    arguments = arguments_of(data)
    status, said, error = _main(arguments)
    if "error: unexpected " in error:
        _main(["--debug", *arguments])  # raises what went wrong
        raise NotInOrder(error)
    if not all(line.isprintable() for line in error.replace("\t", "").split("\n")):
        raise NotInOrder(f"raw characters on the terminal: {error!r}")
    lines = [line for line in error.split("\n") if line.strip()]
    if status == 0 or (status == 2 and "\nCompare engines:\n" in said + error):  # the whole help
        return
    if status == 1 and lines[-1:] == ["Aborted."]:
        raise RefusedLine("asked, and nobody answered")
    wrong = [line for line in lines if line.lower().startswith("error: ")]
    if status != 2 or len(wrong) != 1 or wrong[0] != lines[-1] or len(wrong[0]) > 1500:
        raise NotInOrder(f"exit status {status}: {error[:3000]!r}")
    raise RefusedLine(wrong[0])


def _main(arguments: list[str]) -> tuple[int | str | None, str, str]:
    """Exit status, output and errors of the program, whose work is left out, in a folder of its own."""
    out, error = io.StringIO(), io.StringIO()
    argv = ["looping-pendulum", *arguments]
    with _fresh_folder(), contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(cli, "app", _command()))
        for work in WORK:
            stack.enter_context(mock.patch(work, side_effect=SystemExit(0)))
        stack.enter_context(mock.patch.object(sys, "argv", argv))
        stack.enter_context(mock.patch.object(sys, "stdin", io.StringIO()))
        stack.enter_context(mock.patch.object(warnings, "formatwarning", warnings.formatwarning))
        stack.enter_context(mock.patch.dict(os.environ))
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(error))
        try:
            cli.main()
        except SystemExit as ended:
            return ended.code or 0, out.getvalue(), error.getvalue()
    raise NotInOrder("the program did not end by its exit status")


@contextlib.contextmanager
def _fresh_folder() -> Iterator[None]:
    home = os.getcwd()
    shutil.rmtree("work", ignore_errors=True)
    shutil.copytree("pristine", "work")
    os.chdir("work")
    try:
        yield
    finally:
        os.chdir(home)

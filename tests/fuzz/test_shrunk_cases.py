"""Inputs that once ended in a traceback or in no time at all, each with the line that it must give now.

Most were found by `make fuzz`, the others by faults put in on purpose.
"""

from functools import cache

import pytest

from looping_pendulum.compare.trajectories import CSV_HEADER
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.tables.readers import DataError, read
from tests.fuzz.command_lines import encoded
from tests.fuzz.damage import BLANKS
from tests.fuzz.judging import CPU_LIMIT, time_limit, was_accepted
from tests.fuzz.kinds import EVENT_TABLES, KINDS

HALF = '"\\ud800"'
"""A lone surrogate, as YAML and JSON let one write it."""


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory):
    """Return a cached function: kind -> the folder where its inputs are run, with the files that they name."""

    @cache
    def folder(kind):
        made = tmp_path_factory.mktemp(kind)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(made)
            KINDS[kind].seeds()
        return made

    return folder


GOOD = """\
title: A trial
light: {mass: 10 g}
heavy: {mass: 100 g}
rod: {radius: 6.25 mm}
release: {angle: 112 deg, free_length: 58 cm}
duration: 1 s
"""
STUDY = """\
title: A study
apparatus: {light: {mass: 10 g}, rod: {radius: 6.25 mm}}
effects: {gravity: 9.81 m/s^2}
trials:
- file: trials/first.csv
  tracks: {light: light, heavy: heavy}
  heavy: {mass: 100 g}
  release: {angle: 112 deg, free_length: 58 cm}
"""
MAP = "title: A map\nscenario: held\nparameters:\n  rod_radius: [1 mm, 2 mm]\n"
RUN = ",".join(CSV_HEADER) + "\n0,0,0,0,0,1,0,0,0,,,,,,,\n0.1,0,0,0,0,1,0,0,0,,,,,,,\n"

FILES = [
    # pint answers "nan" with a ValueError of its own, since it takes it for a number
    ("scenario", GOOD.replace("6.25 mm", "1 nan"), "any.yaml:4: rod.radius: expected a length, got '1 nan' ('nan' is no"),
    ("scenario", GOOD.replace("6.25 mm", "1 / *"), "any.yaml:4: rod.radius: expected a length, got '1 / *'"),
    ("scenario", GOOD.replace("A trial", HALF), "any.yaml:1: found '\\ud800', which is half a character, needed text"),
    ("scenario", GOOD.replace("title", HALF), "any.yaml:1: found '\\ud800', which is half a character, needed text"),
    ("scenario", GOOD.replace("6.25 mm", HALF), "any.yaml:4: found '\\ud800', which is half a character, needed text"),
    ("study", STUDY.replace("100 g", "100 nan +/- 1 g"), "any.yaml:7: trials[0].heavy.mass: expected a mass, got '100 nan'"),
    ("study", STUDY.replace("A study", HALF), "any.yaml:1: found '\\ud800'"),
    # \s* before and after the sign took quadratic time
    ("study", STUDY.replace("100 g", f"100 g +/-{BLANKS[:50_000]}x"), "trials[0].heavy.mass: found 'x' after '+/-'"),
    ("study", STUDY.replace("100 g", f'"(65 +/- 1{")" * 50_000}\\n x"'), "trials[0].heavy.mass: expected a mass, got '65"),
    ("study", STUDY.replace("100 g", "100 g +/- 1_0 %"), "trials[0].heavy.mass: found '1_0 %' after '+/-'"),
    # its square is no number any more, which was a warning of NumPy's
    ("study", STUDY.replace("58 cm", "58 cm, hanging_length: 5e300 cm"), "needed a finite number above 0 and at most 1e+09"),
    ("map", MAP.replace("1 mm", "1 nan"), "any.yaml:4: parameters.rod_radius.values: expected a length, got '1 nan'"),
    ("map", MAP.replace("A map", HALF), "any.yaml:1: found '\\ud800'"),
    ("events", EVENT_TABLES[0].replace(b",s\n", b",nan\n", 1), "any.csv:3: column unit: found 'nan', needed a unit of"),
    ("events", EVENT_TABLES[0].replace(b",s\n", b",/ *\n", 1), "any.csv:3: column unit: found '/ *', needed a unit of"),
    # the csv module takes no cell of more than 131 072 characters, which was an error of its own
    ("events", EVENT_TABLES[0].replace(b"27.1", b"1" * 140_000), "any.csv:5: found more than 20000 characters in a line"),
    ("readers", b"t,x,y\n0,1,2\n1," + b"1" * 140_000 + b",2\n", "any.csv:3: found more than 20000 characters in a line"),
    ("run-file", RUN.encode() + b"0.2,\xe4\n", "reference-quick.csv: found no run ('utf-8' codec can't decode byte 0xe4"),
    ("run-file", RUN.replace("0.1", "0"), "reference-quick.csv: found no run (`x` must be strictly increasing sequence."),
    ("run-file", RUN.replace("0.1", "nan"), "reference-quick.csv: found no run (numbers that no motion has)"),
    ("run-file", RUN.replace("0.1", "1e300"), "reference-quick.csv: found no run (numbers that no motion has)"),
    ("run-file", RUN.replace("0.1", "1e6"), "so 2.4e+08 frames, needed at most 10000000; correct them"),
    ("baseline", "[" * 100_000, "recursion limit exceeded"),
    ("baseline", '{"schema": ' + "[" * 200 + "]" * 200 + "}", "schema: found a list, needed the id"),
    ("baseline", f'{{"schema": {"9" * 5000}}}', "number out of range at line 1"),
    ("baseline", f'{{"schema": {HALF}}}', "unexpected end of hex escape at line 1"),
]  # fmt: skip


def read_time(tmp_path, text):
    path = tmp_path / "events.csv"
    path.write_text(f"quantity,index,measured,paper_numerical,unit\nstop,1,{text},,s\n")
    (event,) = read(path, kind="events").events
    return event.sigma


@pytest.mark.parametrize(("text", "sigma"), [("0.351", 1e-3), ("1.5e-3", 1e-4), ("2.5e2", 10.0), ("12", 1.0), ("0", 1.0)])
def test_the_error_of_a_printed_time_is_its_last_digit(tmp_path, text, sigma):
    assert read_time(tmp_path, text) == sigma


@pytest.mark.parametrize("text", ["0e400", "0e-400"])
def test_a_zero_with_an_absurd_exponent_has_no_last_digit(tmp_path, text):
    with pytest.raises(
        DataError, match=r"events.csv:2: column measured: found '0e-?400', whose last digit is worth (inf|0), needed"
    ):
        read_time(tmp_path, text)  # 10.0**400 was an OverflowError


SLOW = [
    ("units", b"1 nan"),
    ("units", b"1 / *"),
    ("units", b"9**9**9 B"),
    ("units", b")"),
    ("units", b"\xfe"),
    ("units", b"10 g +/-" + BLANKS.encode()),
    ("units", b"4 cm" + BLANKS.encode() + b"x ["),
    ("units", b"(" * 50_000),
    # (.*?)\s*[\[(] before a bracket that never closes took quadratic time, and so did \d+\.?\d* before what is no number
    ("readers", f"t,x{BLANKS[:90_000]}[cm,y\n0,1,2\n".encode()),
    ("readers", b"t,x,y\n0," + b"1" * 90_000 + b"x,2\n"),
    # [0-9]*\.?[0-9]+ in a column with a date, and blanks that begin a line, took quadratic time
    ("readers", b"t,x,y\n0,03. Aug,2\n1," + b"1" * 90_000 + b"x,2\n"),
    ("readers", b"t,x,y\n" + b" " * 90_000 + b"x\n0,1,2\n"),
]


@pytest.mark.parametrize(("kind", "data"), SLOW, ids=[f"{kind}: {data[:12]!r}" for kind, data in SLOW])
def test_a_hostile_text_is_refused_or_read_in_time(kind, data, folder_of, monkeypatch):
    monkeypatch.chdir(folder_of(kind))
    was_accepted(KINDS[kind].run, data)


LINES = [
    (["run", "drop", "--jobs", "999999999"], "Invalid value for '--jobs'"),
    (["run", "\x1b[2J\u202egnp.yaml"], "error: \\x1b[2J\\u202egnp.yaml: found neither a file nor a shipped scenario"),
    (["run", "drop", "-e", "\u202emujoco"], "\\u202emujoco"),
    (["engines", "x" * 100_000], "Error: Got unexpected extra argument"),
    (["scenarios", "drop", "\u2028"], "Error: Got unexpected extra argument(s) (\\u2028)"),
    (["tracker", "runs.csv", "--start", "1e300"], "--start, --fps: found 1e+300 s and 240 frames per second"),
    (["map", "quick", "--cluster", "nonsense"], "--cluster: found 'nonsense', needed the address of a Dask scheduler"),
    (["new", "study", "nope.csv", "--out", "s.yaml"], "found no file 'nope.csv'"),
    (["run", "bad.yaml"], "bad.yaml:"),
]  # fmt: skip


REFUSED = [
    *FILES,
    *(("command-line", encoded(arguments), said) for arguments, said in LINES),
]


@pytest.mark.parametrize(("kind", "content", "said"), REFUSED, ids=[f"{kind}: {said[:50]}" for kind, _, said in REFUSED])
def test_a_hostile_input_gives_its_line(kind, content, said, folder_of, monkeypatch):
    monkeypatch.chdir(folder_of(kind))
    with time_limit(CPU_LIMIT), pytest.raises(HarnessError) as caught:  # of a command line, too, and its status was 2
        KINDS[kind].run(content if isinstance(content, bytes) else content.encode())
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)

"""Measured event tables: found where they may be, and read or refused in one line."""

import hashlib

import pytest

from looping_pendulum.measured.events import find_data, read_event_table
from looping_pendulum.measured.observations import DataError

HEAD = "quantity,index,measured,paper_numerical,unit\n"


@pytest.fixture
def table(tmp_path):
    def write(text: str | bytes):
        path = tmp_path / "trial.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_reads_rows_in_si(table):
    rows = read_event_table(
        table(f"# comment\n{HEAD}\nx1_extremum,2,0.52,0.53,s\ndrop,1,37,,cm\nwrap_angle_at_halt,1,,4.738,rad\n")
    ).rows
    assert [(r.quantity, r.index, r.measured, r.paper_numerical, r.unit) for r in rows] == [
        ("x1_extremum", 2, 0.52, 0.53, "s"),
        ("drop", 1, 0.37, None, "m"),
        ("wrap_angle_at_halt", 1, None, 4.738, "rad"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"# c\n{HEAD}halt,1,x,0.3,s\n", ":3: column measured: found 'x', needed a number or an empty cell"),
        (f"{HEAD}halt,1,inf,0.3,s\n", ":2: column measured: found 'inf', needed a number or an empty cell"),
        (f"{HEAD}halt,1,0.3,1e999,s\n", ":2: column paper_numerical: found '1e999', needed a finite number"),
        (f"{HEAD}halt,0,1,1,s\n", ":2: column index: found '0', needed a whole number from 1"),
        (f"{HEAD}halt,one,1,1,s\n", ":2: column index: found 'one', needed a whole number from 1"),
        (f"{HEAD}halt,1,1,1,furlong\n", ":2: column unit: found 'furlong', needed a unit of time, length or angle"),
        (f"{HEAD},1,1,1,s\n", ":2: column quantity: found nothing, needed a name"),
        (f"{HEAD}halt,1,1,s\n", ":2: found 4 cells, needed 5"),
        (f"{HEAD}halt,1,1,1,s\nhalt,1,1,1,s\n", ":3: column index: found halt 1 again (first on line 2)"),
        ("a,b\n1,2\n", ":1: found columns 'a,b', needed 'quantity,index,value,sigma,unit' or 'quantity,index,measured"),
        ("", ": found no rows, needed"),
        (HEAD, ":1: found no rows below the names of the columns, needed"),
        (HEAD.encode() + b"\xff\n", ":2: found 1 cells, needed 5"),
        (b"#" * 2_000_000, ": found more than 1 MiB"),
    ],
)
def test_a_faulty_table_gives_its_line(table, text, message):
    path = table(text)
    with pytest.raises(DataError) as caught:
        read_event_table(path)
    assert str(caught.value).startswith(f"{path}{message}")
    assert str(caught.value).isprintable()


def test_checksum_must_agree(table):
    path = table(f"{HEAD}halt,1,0.4,0.38,s\n")
    right = hashlib.sha256(path.read_bytes()).hexdigest()
    assert len(read_event_table(path, right.upper()).rows) == 1
    with pytest.raises(DataError, match="found SHA-256 .*, needed 000000000000"):
        read_event_table(path, "0" * 64)


def test_a_missing_table_is_said(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        read_event_table(tmp_path / "none.csv")


def test_looks_in_the_given_folder_then_the_variable_then_nearby(tmp_path, monkeypatch):
    work = tmp_path / "work"
    given, named, near = tmp_path / "given", tmp_path / "named", work / "data"
    for folder in (given, named, near):
        (folder / "paper").mkdir(parents=True)
        (folder / "paper" / "t.csv").touch()
    monkeypatch.chdir(work)
    monkeypatch.setenv("LOOPING_PENDULUM_DATA", str(named))
    find = lambda folders=None: find_data("paper/t.csv", folders)  # noqa: E731
    assert find(given) == find([tmp_path / "nowhere", given]) == given / "paper/t.csv"
    assert find(tmp_path / "nowhere") == find() == named / "paper/t.csv"
    monkeypatch.delenv("LOOPING_PENDULUM_DATA")
    assert find().resolve() == near / "paper/t.csv"
    (near / "paper" / "t.csv").unlink()
    assert find() is None

"""Files of tracked points on the live page: the oracle is the reader of `identify`, on good, bad and damaged files alike."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.discrepancy.data.readers import DataError, read
from looping_pendulum.teaching.example_folder import write_example
from tests.discrepancy.test_readers import BAD, FORMS

FILE = "clip.csv"
ROUNDING = 1e-12
DAMAGED = 300
SEED = 20261123
NOT_ON_THE_PAGE = re.compile("event|kind")
"""Cases of tables of events, which the page sends to `identify`, and of the kind of a file, which the page does not ask for."""
UNIT_DETAIL = re.compile(r" \('?[^()]*'? is no [^()]*\)")
"""What pint says of a unit that is none."""


@pytest.fixture
def both(node, tmp_path, monkeypatch):
    """Read contents with options by the reader of `identify` and by the page's: pairs of what each read or said."""
    monkeypatch.chdir(tmp_path)

    def outcomes(contents):
        texts = [(c if isinstance(c, bytes) else c.encode(), options) for c, options in contents]
        files = [{"file": FILE, "bytes": base64.b64encode(raw).decode(), "options": options} for raw, options in texts]
        return zip([by_identify(raw, options) for raw, options in texts], node("read_trials.mjs", files), strict=True)

    return outcomes


def by_identify(raw, options):
    Path(FILE).write_bytes(raw)
    try:
        observations = read(FILE, **options)
    except DataError as error:
        return {"message": UNIT_DETAIL.sub("", str(error))}
    return {
        "channels": [{"name": c.name, "t": c.t, "value": c.value} for c in observations.channels],
        "unused": {u.reason: u.count for u in observations.unused},
        "assumptions": list(observations.assumptions),
    }


def assert_same(expected, found):
    assert found.get("message") == expected.get("message")
    if "message" in expected:
        return
    # Here alone the page keeps more: it draws no rates, so it need not judge them
    channels = [c for c in found["channels"] if c["name"] != "angle_rate"]
    assert [c["name"] for c in channels] == [c["name"] for c in expected["channels"] if c["name"] != "angle_rate"]
    for mine, theirs in zip(channels, (c for c in expected["channels"] if c["name"] != "angle_rate"), strict=True):
        assert mine["t"] == pytest.approx(theirs["t"], rel=ROUNDING, abs=ROUNDING)
        assert mine["value"] == pytest.approx(theirs["value"], rel=ROUNDING, abs=ROUNDING)
    assert found["unused"] == {reason: n for reason, n in expected["unused"].items() if n and "not the rate" not in reason}
    assert found["assumptions"] == expected["assumptions"]


def test_every_form_gives_what_identify_reads(both):
    for expected, found in both(FORMS.values()):
        assert "message" not in expected
        assert_same(expected, found)


def test_a_bad_file_gives_the_message_of_identify(both):
    cases = [(text, options) for name, (text, options, _) in BAD.items() if not NOT_ON_THE_PAGE.search(name)]
    assert len(cases) > 25
    for expected, found in both(cases):
        assert "message" in expected
        assert_same(expected, found)


def test_a_table_of_events_is_sent_to_identify(both):
    [(_, found)] = both([("quantity,index,value,sigma,unit\nstop,1,1,1,s\n", {})])
    assert found["message"] == (
        f"{FILE}: found a table of events, needed tracked points; looping-pendulum identify reads such tables"
    )


def test_damaged_files_are_read_or_refused_alike(both, tmp_path):
    rng = np.random.default_rng(SEED)
    [path] = [p for p in write_example(tmp_path / "example") if p.name == "first.csv"]
    whole = path.read_text(encoding="utf-8").splitlines(keepends=True)[:30]
    outcomes = list(both([("".join(damaged(rng, whole)), {}) for _ in range(DAMAGED)]))
    refused = sum("message" in expected for expected, _ in outcomes)
    assert 0.2 < refused / DAMAGED < 0.9
    for expected, found in outcomes:
        assert_same(expected, found)


def damaged(rng, lines):
    """Return lines with one to three faults as people and programs make them."""
    lines = list(lines)
    for _ in range(rng.integers(1, 4)):
        i = int(rng.integers(len(lines)))
        line = lines[i]
        place = int(rng.integers(max(len(line), 1)))
        faults = [
            lambda line=line, place=place: line[:place] + line[place + 1 :],
            lambda line=line, place=place: line[:place] + str(rng.choice(list(';,\t x-.9E"#'))) + line[place:],
            lambda line=line: line.replace(".", ","),
            lambda line=line: line.replace(",", ";"),
            lambda line=line: line * 2,
            lambda: "",
        ]
        lines[i] = faults[int(rng.choice(len(faults), p=[0.3, 0.4, 0.05, 0.05, 0.1, 0.1]))]()
    return lines

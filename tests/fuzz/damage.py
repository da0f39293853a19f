"""Damage to inputs: words, values, numbers, lines and bytes, each drawn by Hypothesis, which makes a failing input smaller."""

import re
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import strategies as st

BLANKS = " " * 130_000
"""More than an expression with backtracking gets through, and about as long as the longest cell of the csv module."""

WORDS = (
    # numbers at and beyond every edge
    "0", "-0", "-1", "0e400", "1e400", "1e-400", "1e999", "1e99999999999", "nan", "inf", "-Infinity", "9" * 25, "9" * 5000,
    "1_000", "0x10", "1,5", "1.5.5", ".", "-", "e", "1e", "٣", "½", "1e308", "5e-324", "1" * 40_000,
    # quantities and their spellings
    "1 nan", "1 / *", "9**9**9 B", "2 GiB", "6.25 mm", "10 g", "112 deg", "3 %", "1 m^9", "1 nm^9*nm^9*nm^9*nm^9", "µm", "° ",
    "1 in in in", "1 None", "1 __class__", "+/- 1 %", "±", "10 g +/- 1 g", "(65 +/- 1) cm", "(65 +/- 1" + ")" * 30_000, "free",
    "free from 3", "+/-" + BLANKS, "10 g" + BLANKS + "+/- 1 g", "x [" + BLANKS, "_" * 20_000, "[" * 20_000, "x]" * 10_000,
    # text that may hurt a terminal, a parser or a page
    "\x1b[31mred\x1b[0m", "\u202egnp.exe", "\ufeff", "\x85", "\u2028", "\x00", "\udc80", '"\\ud800"', "[/x]", "</script>",
    "{{7*7}}", "%s%n", "../x", "/dev/null", "~", "é",
    # YAML and JSON
    ":", "- ", "? ", "---", "&a", "*a", "<<: *a", "!!python/name:os.system", "!x", "|", "#", "'", '"', "{", "[", "[" * 50,
    "{a: b}", "[1, 2]", "null", "true", "\t", "a: b", "{}", "[]", "1e999", "[" * 5000 + "]" * 5000, '{"a": 1}',
    # tables
    "#multi:", "t", "x", "frame", "drop", "angle", "light_x", "heavy_y [cm]", "quantity", "unit", "sigma", '"a,b', "\r", "\r\n",
    "\n", ";", ",,,,,,", "0,5",
)  # fmt: skip
"""What is put in anywhere."""
FACTORS = (0.0, -1.0, 0.5, 2.0, 10.0, 1e-3, 1e3, 1e-12, 1e12, 1e-300, 1e300)
SIGNS = (b",", b";", b"\t", b" ", b".", b":", b"\n", b"\r\n", b"\r", b'"', b"'", b"-", b"e", b"[", b"(", b"]", b")")
TOKEN = re.compile(rb"[\w.+-]+")
VALUE = re.compile(rb"(?<=[:,;\t\n\[])[^:,;\t\n\]}]*")
NUMBER = re.compile(rb"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")

Draw = Callable[[st.SearchStrategy[Any]], Any]


def encoded(word: str) -> bytes:
    """Bytes of a word; half characters, too, as no program would write them."""
    return word.encode("utf-8", "surrogatepass")


def words() -> st.SearchStrategy[bytes]:
    return st.sampled_from(WORDS).map(encoded)


def _replace(draw: Draw, data: bytes, pattern: re.Pattern[bytes], new: Callable[[bytes], bytes]) -> bytes:
    """Put something in place of one of the parts that a pattern finds."""
    found = list(pattern.finditer(data))
    if not found:
        return draw(words())
    part = draw(st.sampled_from(found))
    return data[: part.start()] + new(part[0]) + data[part.end() :]


def other_token(draw: Draw, data: bytes) -> bytes:
    return _replace(draw, data, TOKEN, lambda _: draw(words()))


def other_value(draw: Draw, data: bytes) -> bytes:
    return _replace(draw, data, VALUE, lambda _: b" " + draw(words()))


def copied_value(draw: Draw, data: bytes) -> bytes:
    values = VALUE.findall(data) or [data]
    return _replace(draw, data, VALUE, lambda _: draw(st.sampled_from(values)))


def other_number(draw: Draw, data: bytes) -> bytes:
    return _replace(draw, data, NUMBER, lambda old: b"%.12g" % (float(old[:30]) * draw(st.sampled_from(FACTORS))))


def other_bytes(draw: Draw, data: bytes) -> bytes:
    start = draw(st.integers(0, len(data)))
    return data[:start] + draw(words() | st.binary(max_size=3)) + data[start + draw(st.integers(0, 40)) :]


def other_lines(draw: Draw, data: bytes) -> bytes:
    """Leave out, repeat, exchange or indent a line."""
    lines = data.split(b"\n")
    i, j = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
    how = draw(st.sampled_from(("leave out", "repeat", "exchange", "indent")))
    if how == "leave out":
        del lines[i]
    elif how == "repeat":
        lines.insert(j, lines[i])
    elif how == "exchange":
        lines[i], lines[j] = lines[j], lines[i]
    else:
        lines[i] = b"  " + lines[i]
    return b"\n".join(lines)


def other_signs(draw: Draw, data: bytes) -> bytes:
    return data.replace(draw(st.sampled_from(SIGNS)), draw(st.sampled_from(SIGNS)))


def cut_off(draw: Draw, data: bytes) -> bytes:
    return data[: draw(st.integers(0, len(data)))]


def other_encoding(draw: Draw, data: bytes) -> bytes:
    text = data.decode("utf-8", "replace")
    return text.encode(draw(st.sampled_from(("utf-16", "utf-16-le", "latin-1", "utf-8-sig", "utf-32", "cp037"))), "replace")


DAMAGES = (
    other_number, other_token, other_value, copied_value, other_lines, other_bytes, other_signs, cut_off, other_encoding
)  # fmt: skip


@st.composite
def damaged(draw: Draw, seeds: Sequence[bytes]) -> bytes:
    """Return one of some real inputs, damaged once or several times."""
    data: bytes = draw(st.sampled_from(seeds))
    for damage in draw(st.lists(st.sampled_from(DAMAGES), min_size=1, max_size=4)):
        data = damage(draw, data)
    return data

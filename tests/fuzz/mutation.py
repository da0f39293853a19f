"""Damage to inputs: bytes, words, lines, cells and JSON values, each chosen by a seeded generator."""

import json
import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

BLANKS = " " * 130_000
"""More than an expression with backtracking gets through, and about as long as the longest cell of the csv module."""

WORDS = (
    # numbers at and beyond every edge
    "0", "-0", "1", "-1", "0e400", "1e400", "-1e400", "1e-400", "1e999", "1e9999", "1e99999999999", "nan", "NaN", "inf",
    "-Infinity",
    "9" * 25, "9" * 5000, "-" + "9" * 400, "1_000", "0x10", "1,5", "1.5.5", ".", "-", "+", "e", "1e", "٣", "½", "1e308",
    "5e-324",
    "1" * 40_000,
    # quantities and their spellings
    "1 nan", "1 / *", "/ *", "1 inf", "9**9**9", "9**9**9 B", "2 GiB", "6.25 mm", "10 g", "112 deg", "1 s", "0.34", "3 %",
    "1 m^9",
    "1 m^-9*m^-9*m^-9", "1 nm^9*nm^9*nm^9*nm^9", "µm", "°", "² m", "1 in in in", "1 e", "1 None", "1 True", "1 __class__",
    "nan kg",
    "+/-", "+/- 1 %", "±", "10 g +/- 1 g", "(65 +/- 1) cm", "(65 +/- 1)" + ")" * 30_000, "free", "free from 3", "+/-" + BLANKS,
    "10 g" + BLANKS + "+/- 1 g", "x" + BLANKS + "[cm]", "x [" + BLANKS, BLANKS, "_" * 20_000, "[" * 20_000, "x]" * 10_000,
    # text that may hurt a terminal, a parser or a page
    "\x1b[31mred\x1b[0m", "\u202egnp.exe", "\u200f", "\ufeff", "\x85", "\u2028", "\x0b", "\x00", "\x07", "\udc80", "\\ud800",
    '"\\ud800"',
    '"\\ud83d\\ude00"', "[/x]", "[bold]", "</script>", "{{7*7}}", "%s%n", "$(id)", "..", "../x", "/dev/null", "~", "CON", "é",
    # YAML
    ":", "- ", "? ", "---", "...", "&a", "*a", "<<: *a", "!!python/name:os.system", "!!float 1", "!x", "|", ">", "#", "'", '"',
    "{", "}", "[",
    "]", ",", "{" * 50, "[" * 50, "[[", "{a: b}", "[1, 2]", "null", "~", "true", "no", "\t", "a: b", "? a", "{}", "[]",
    # tables
    "#multi:", "t", "x", "y", "frame", "drop", "angle", "height", "light_x", "heavy_y [cm]", "quantity", "index", "measured",
    "unit", "sigma",
    '"a,b', "\r", "\r\n", "\n", ";", "\t\t", ",,,,,,", "1,2", "0,5",
)  # fmt: skip
"""What is put in anywhere."""

Mutation = Callable[[Random, bytes], bytes]


def encoded(word: str) -> bytes:
    """Bytes of a word; half characters, too, as no program would write them."""
    return word.encode("utf-8", "surrogatepass")


def some_word(random: Random, words: Sequence[str] = WORDS) -> bytes:
    """Return one of the words, by a chance a few of them in a row."""
    chosen = encoded(random.choice(words))
    return chosen if random.random() < 0.9 else chosen + random.choice((b"", b" ")) + encoded(random.choice(words))


def _place(random: Random, data: bytes, longest: int = 40) -> tuple[int, int]:
    start = random.randrange(len(data) + 1)
    return start, min(len(data), start + random.randrange(longest))


def change_bytes(random: Random, data: bytes) -> bytes:
    """Put random bytes in place of some."""
    start, end = _place(random, data, 4)
    return data[:start] + random.randbytes(random.randrange(1, 4)) + data[end:]


def delete_bytes(random: Random, data: bytes) -> bytes:
    """Leave some bytes out."""
    start, end = _place(random, data)
    return data[:start] + data[end:]


def repeat_bytes(random: Random, data: bytes) -> bytes:
    """Write some bytes again and again."""
    start, end = _place(random, data)
    return data[:end] + data[start:end] * random.choice((1, 1, 2, 10, 300)) + data[end:]


def cut_off(random: Random, data: bytes) -> bytes:
    """End early."""
    return data[: random.randrange(len(data) + 1)]


def put_word(random: Random, data: bytes) -> bytes:
    """Put a word in anywhere."""
    start, end = _place(random, data, 2)
    return data[:start] + some_word(random) + data[end:]


def replace_token(random: Random, data: bytes) -> bytes:
    """Put a word in place of one of the file's."""
    tokens = list(re.finditer(rb"[\w.+-]+", data))
    if not tokens:
        return some_word(random)
    token = random.choice(tokens)
    return data[: token.start()] + some_word(random) + data[token.end() :]


def replace_value(random: Random, data: bytes) -> bytes:
    """Put a word in place of what stands behind a colon or between separators."""
    values = list(re.finditer(rb"(?<=[:,;\t\n\[])[^:,;\t\n\]}]*", data))
    if not values:
        return some_word(random)
    value = random.choice(values)
    return data[: value.start()] + b" " + some_word(random) + data[value.end() :]


def copy_value(random: Random, data: bytes) -> bytes:
    """Put one value of the file in place of another."""
    values = list(re.finditer(rb"(?<=[:,;\t\n\[])[^:,;\t\n\]}]+", data))
    if not values:
        return data
    source, target = random.choice(values), random.choice(values)
    return data[: target.start()] + source[0] + data[target.end() :]


def change_number(random: Random, data: bytes) -> bytes:
    """Multiply a number, or turn its sign, and leave its unit."""
    numbers = list(re.finditer(rb"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?", data))
    if not numbers:
        return data
    number = random.choice(numbers)
    factor = random.choice((0.0, -1.0, 0.5, 2.0, 10.0, 1e-3, 1e3, 1e-12, 1e12, 1e-300, 1e300, random.random()))
    return data[: number.start()] + b"%.12g" % (float(number[0][:30]) * factor) + data[number.end() :]


def change_lines(random: Random, data: bytes) -> bytes:
    """Leave out, repeat, move or indent a line."""
    lines = data.split(b"\n")
    i, j = random.randrange(len(lines)), random.randrange(len(lines))
    how = random.randrange(5)
    if how == 0:
        del lines[i]
    elif how == 1:
        lines.insert(j, lines[i])
    elif how == 2:
        lines[i], lines[j] = lines[j], lines[i]
    elif how == 3:
        lines[i] = b" " * random.randrange(1, 9) + lines[i]
    else:
        lines[i] = lines[i].lstrip()
    return b"\n".join(lines)


def change_signs(random: Random, data: bytes) -> bytes:
    """Put another separator, quote or line end in place of one, everywhere."""
    signs = [b",", b";", b"\t", b" ", b".", b":", b"\n", b"\r\n", b"\r", b'"', b"'", b"-", b"e", b"[", b"(", b"]", b")"]
    return data.replace(random.choice(signs), random.choice(signs))


def change_encoding(random: Random, data: bytes) -> bytes:
    """Write the text as another program would."""
    text = data.decode("utf-8", "replace")
    return text.encode(random.choice(("utf-16", "utf-16-le", "latin-1", "utf-8-sig", "utf-32", "cp037")), "replace")


TEXT_MUTATIONS: tuple[Mutation, ...] = (
    *(change_bytes, delete_bytes, repeat_bytes, cut_off, change_signs, put_word, put_word, change_lines, change_lines),
    *[replace_token] * 3,
    *[replace_value] * 3,
    *[copy_value] * 3,
    *[change_number] * 4,
)


def mutate(random: Random, data: bytes, mutations: Sequence[Mutation] = TEXT_MUTATIONS) -> bytes:
    """Damage ``data`` one to four times."""
    if random.random() < 0.01:
        return change_encoding(random, data)
    for _ in range(random.choice((1, 1, 1, 2, 2, 3, 4))):
        data = random.choice(mutations)(random, data)
    return data


JSON_VALUES: tuple[str, ...] = (
    "null", "true", "false", "0", "-1", "1e999", "-1e999", "NaN", "Infinity", "9" * 5000, "9" * 25, "-" + "9" * 290, "1.5",
    "5e-324",
    '""', '"x"', '"\\ud800"', '"\\u202e"', '"[/x]"', '"\\u0000"', '"pass"', '"m"', "[]", "{}", "[[]]", '{"a": 1}', "[1, 2, 3]",
    "[null]",
    "[" * 30 + "]" * 30, "[" * 5000 + "]" * 5000, '{"a":' * 2000 + "1" + "}" * 2000, '"' + "x" * 100_000 + '"',
)  # fmt: skip


def change_json(random: Random, data: bytes) -> bytes:
    """Put another value in place of one, or a key or an item less or more."""
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return put_word(random, data)
    mark = "\u0001mark\u0001"
    root: Any = {"": tree}
    holder, key = root, ""
    while isinstance(holder[key], dict | list) and holder[key] and random.random() < 0.85:
        holder = holder[key]
        key = random.choice(list(holder)) if isinstance(holder, dict) else random.randrange(len(holder))
    how = random.random()
    if how < 0.2 and holder is not root:
        del holder[key]
    elif how < 0.3 and isinstance(holder, dict) and holder is not root:
        holder[some_word(random).decode("utf-8", "replace")] = holder[key]
    elif how < 0.4 and isinstance(holder, list):
        holder.extend([holder[key]] * random.choice((1, 3)))
    else:
        holder[key] = mark
    return json.dumps(root[""]).replace(json.dumps(mark), random.choice(JSON_VALUES)).encode()

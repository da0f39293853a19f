"""Every faulty file gives one line: file, line, key, what was found, what was needed, and a way out."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from looping_pendulum.errors import ScenarioError
from looping_pendulum.scenarios import load, load_text, shipped
from looping_pendulum.scenarios.document import MAX_FILE_SIZE

GOOD = """\
title: A trial
light: {mass: 10 g, drag: 1e-3 kg/m}
heavy: {mass: 100 g}
rod:
  radius: 6.25 mm
string: {kinetic_friction: 0.3}
release:
  angle: 112 deg
  free_length: 58 cm
duration: 1 s
"""


def fault(text: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_text(text, "my.yaml")
    line = str(caught.value)
    assert "\n" not in line
    assert line.isprintable()
    return line


def test_the_good_file_is_good():
    assert load_text(GOOD, "my.yaml").name == "my"


# (what the good file has, what the bad one has instead, the line that must come out or how it must begin)
REPLACED = [
    ("6.25 mm", "10 g", ":5: rod.radius: expected a length, got '10 g'; write for example '6.25 mm'"),
    ("6.25 mm", "6.25", ":5: rod.radius: expected a length, got '6.25' (the unit is missing); write for example '6.25 mm'"),
    ("6.25 mm", "-6.25 mm", ":5: rod.radius: expected a length above 0, got '-6.25 mm'; write for example"),
    ("6.25 mm", "0 mm", ":5: rod.radius: expected a length above 0, got '0 mm'"),
    ("6.25 mm", "1e-999 mm", ":5: rod.radius: expected a length above 0, got '1e-999 mm'"),
    ("6.25 mm", "", ":5: rod.radius: expected a length, got nothing; write for example '6.25 mm'"),
    ("6.25 mm", "nan mm", ":5: rod.radius: expected a length, got 'nan mm' (it must be finite)"),
    ("6.25 mm", "-.inf", ":5: rod.radius: expected a length, got '-.inf' (it must be finite)"),
    ("6.25 mm", "1e999 mm", ":5: rod.radius: expected a length, got '1e999 mm' (it must be finite)"),
    ("6.25 mm", "6,25 mm", ":5: rod.radius: expected a length, got '6,25 mm' (write a decimal point, not a comma)"),
    (
        "rod:\n  radius: 6.25 mm",
        "rod: {radius: 6,25 mm}",
        ":4: rod.radius: found a comma inside '6,25 mm', needed a decimal point",
    ),
    ("6.25 mm", "6.25 mmm", ":5: rod.radius: expected a length, got '6.25 mmm' ('mmm' is no known unit)"),
    ("6.25 mm", "6.25 m^999999999", ":5: rod.radius: expected a length, got '6.25 m^999999999'"),
    ("6.25 mm", "[1 mm]", ":5: rod.radius: expected a length, got a list"),
    ("6.25 mm", "{a: 1 mm}", ":5: rod.radius: expected a length, got a group of keys"),
    ("6.25 mm", "x" * 500, ":5: rod.radius: expected a length, got 'xxxxxxxx"),
    ("6.25 mm", "6.25 mm\n  radius: 7 mm", ":6: rod.radius: found this key twice (first on line 5), needed it once"),
    ("  radius", "  raduis", ":5: rod.raduis: found an unknown key, needed one of: radius; did you mean 'radius'?"),
    ("  radius: 6.25 mm", "  {}", ":4: rod.radius: missing, needed a length above 0; write for example 'radius: 6.25 mm'"),
    ("rod:\n  radius: 6.25 mm", "rod: 6.25 mm", ":4: rod: expected a group of keys (radius), got '6.25 mm'"),
    ("rod:\n  radius: 6.25 mm\n", "", ": rod: missing, needed a group of keys (radius)"),
    ("title", "titel", ":1: titel: found an unknown key, needed one of: title, "),
    ("rod:", "kinetic_friction: 0.3\nrod:", ":4: kinetic_friction: found an unknown key, needed one of: title, "),
    ("A trial", "[a, b]", ":1: title: expected text, got a list"),
    ("0.3", "0.3 m", ":6: string.kinetic_friction: expected a plain number, got '0.3 m'; write for example '0.34'"),
    ("0.3", "17 deg", ":6: string.kinetic_friction: expected a plain number, got '17 deg'"),
    ("0.3", "-0.3", ":6: string.kinetic_friction: expected a plain number from 0 to 5, got '-0.3'"),
    ("0.3}", "0.3, static_friction: 0.2}", ":6: string.static_friction: found 0.2, needed at least kinetic_friction (0.3)"),
    ("112 deg", "112", ":8: release.angle: expected an angle, got '112' (the unit is missing); write for example '112 deg'"),
    ("112 deg", "400 deg", ":8: release.angle: expected an angle above 0 up to 360 deg, got '400 deg'"),
    ("112 deg", "360 deg", ":8: release.angle: found 360 deg, needed between 0 and 360 deg"),
    ("  angle: 112 deg\n", "", ":7: release.angle: missing, and a looping release needed an angle"),
    ("  angle", "  kind: vertical\n  angle", ":9: release.angle: found 112 deg, needed no angle: a vertical release hangs"),
    ("  angle", "  kind: lopping\n  angle", ":8: release.kind: expected one of looping, vertical, held, drop, got 'lopping'"),
    ("10 g", "10 g, radius: 70 cm", ":9: release.free_length: found 0.58 m, but the light mass already touches the rod"),
    ("1e-3 kg/m", "5 kg/m", ":2: light.drag: expected a drag coefficient (mass per length) from 0 to 1 kg/m, got '5 kg/m'"),
    ("1e-3 kg/m", "{area: 4 cm^2}", ":2: light.drag.shape_factor: missing, needed a plain number from 0 to 10"),
    (
        "1e-3 kg/m",
        "{area: 4 cm, shape_factor: 1}",
        ":2: light.drag.area: expected an area, got '4 cm'; write for example '4 cm^2'",
    ),
    ("1e-3 kg/m", "{area: 1 m^2, shape_factor: 5}", ":2: light.drag: found 3, needed between 0 and 1"),
    ("1 s", "1e9 s", ":10: duration: expected a time above 0 up to 3600 s, got '1e9 s'"),
    # What YAML itself allows and a scenario does not
    ("6.25 mm", "&a 6.25 mm", ":5: found the YAML anchor or alias '&a', needed the value itself"),
    ("6.25 mm", "*a", ":5: found the YAML anchor or alias '*a', needed the value itself"),
    ("6.25 mm", "!!python/object/apply:os.system [ls]", ":5: found the YAML tag 'tag:yaml.org,2002:python/object/apply:os.sys"),
    ("title", "!x title", ":1: found the YAML tag '!x', needed a plain value"),
]


@pytest.mark.parametrize(("old", "new", "line"), REPLACED, ids=[f"{o.strip()[:12]}->{n.strip()[:24]}" for o, n, _ in REPLACED])
def test_a_wrong_value_gives_its_line(old, new, line):
    assert fault(GOOD.replace(old, new, 1)).startswith(f"my.yaml{line}")


APPENDED = [
    (
        "effects: {light_drag: 1 kg/m}",
        ":11: effects.light_drag: found an unknown key, needed another; write it as 'light.drag'",
    ),
    ("inferred: x", ":11: inferred: expected a list, got 'x'"),
    ("inferred:\n- {parameters: [release.angel], how: x}", ":12: inferred[0].parameters[0]: expected a key of this file"),
    ("inferred:\n- {parameters: [rod.radius], how: []}", ":12: inferred[0].how: expected text, got a list"),
    ("measured: {file: ../x, sha256: ab, source: s}", ":11: measured.file: expected a path below a data folder"),
    ("measured: {file: /x, sha256: ab, source: s}", ":11: measured.file: expected a path below a data folder"),
    ("measured: {file: x, sha256: ab, source: s}", ":11: measured.sha256: expected 64 hexadecimal digits, got 'ab'"),
    (
        "tolerances: {a:b: {accurate: {rms: {limit: 1 mm, reason: r}}}}",
        ":11: tolerances.a:b.accurate.rms: found an unknown key",
    ),
    (
        "tolerances: {a:b: {quick: {rms_0.7s: {limit: 1 s, reason: r}}}}",
        ":11: tolerances.a:b.quick.rms_0.7s.limit: expected a length, got '1 s'; write for example '0.6 mm'",
    ),
    (
        "tolerances: {a:b: {quick: {rms_0.7s: {limit: 1 mm}}}}",
        ":11: tolerances.a:b.quick.rms_0.7s.reason: missing, needed text",
    ),
    ("tolerances: {a:b: {quik: {}}}", ":11: tolerances.a:b.quik: found an unknown key, needed one of: quick, accurate; did"),
    ("tolerances: {a:b: 5}", ":11: tolerances.a:b: expected a group of keys (quick, accurate), got '5'"),
    ("title: again", ":11: title: found this key twice (first on line 1), needed it once"),
    ("? [a]\n: b", ":11: found a list or group as a key, needed a word"),
    ("---\na: b", ":11: found a second document ('---'), needed one scenario per file"),
    ("\tq: 1", ":11: found a tab, needed spaces"),
    ('q: "abc', ":12: found no readable YAML"),
    ("q: : :", ":11: found no readable YAML"),
    ("q: \x07", ":11: found the character '\\x07', needed plain text"),
    ('"\\e[31mred": 1', ":11: \\x1b[31mred: found an unknown key"),
    ("a: " + "[" * 50_000, ":11: found more than 12 levels of nesting"),
    # A key that begins with a digit was taken for the rest of a number, even after a group: a TypeError
    ("lights: {a: {b: c}, 0x10: d}", ":11: lights: found an unknown key"),
    # A point in a key is no group's
    ("tolerances: {a:b: {quick: {\n  rms_0.5s: {limit: 1 s, reason: r}}}}", ":12: tolerances.a:b.quick.rms_0.5s: found an unk"),
    ("<<: {a: b}", ":11: <<: found an unknown key"),
    ("<effects>: {}", ":11: found the unknown key '<effects>', needed one without brackets"),
]


@pytest.mark.parametrize(("extra", "line"), APPENDED, ids=[extra[:30] for extra, _ in APPENDED])
def test_a_wrong_addition_gives_its_line(extra, line):
    assert fault(f"{GOOD}{extra}\n").startswith(f"my.yaml{line}")


@pytest.mark.parametrize("text", ["", "\n", "# only a comment\n", "null", "---\n"])
def test_an_empty_file_says_so(text):
    assert fault(text).startswith("my.yaml: found an empty file, needed a scenario")


@pytest.mark.parametrize(("text", "shown"), [("- a", "a list"), ("hello", "'hello'")])
def test_a_file_without_keys_says_so(text, shown):
    assert fault(text).startswith(f"my.yaml: found {shown}, needed keys with values")


def test_an_alias_bomb_is_refused_at_its_first_anchor():
    levels = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 10)]
    bomb = "\n".join(["a0: &a0 [lol, lol]", *levels])
    assert fault(bomb).startswith("my.yaml:1: found the YAML anchor or alias '&a0'")


def test_an_unknown_key_is_named_before_the_key_it_was_meant_for():
    assert "rod.raduis" in fault(GOOD.replace("radius", "raduis"))


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (GOOD.encode() + b"# caf\xe9\n", ":11: found the byte 0xe9, needed UTF-8 text"),
        (GOOD.encode("utf-16"), ":1: found the byte 0xff, needed UTF-8 text"),
        (GOOD.encode() + b"#" * MAX_FILE_SIZE, ": found more than 64 KiB, needed a scenario of a few KiB"),
    ],
    ids=["latin-1", "utf-16", "huge"],
)
def test_unreadable_bytes_are_named(tmp_path, raw, message):
    path = tmp_path / "my.yaml"
    path.write_bytes(raw)
    with pytest.raises(ScenarioError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}{message}")


@pytest.mark.parametrize("name", ["tento_one", "ten_to_one.yml", "", "x\0", "a" * 10_000, "/nowhere/x.yaml", "."])
def test_an_unknown_name_lists_what_there_is(name):
    with pytest.raises(ScenarioError) as caught:
        load(name)
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) < 400
    assert all(known in line for known in shipped())
    assert ("did you mean 'ten_to_one'?" in line) == ("to_one" in name)


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=80))
def test_no_text_gives_anything_but_a_scenario_error(text):
    with pytest.raises(ScenarioError) as caught:
        load_text(text, "my.yaml")
    assert str(caught.value).isprintable()


@settings(max_examples=200, deadline=None)
@given(
    st.text(max_size=30).filter(lambda text: "\ud800" > text or text > "\udfff"),
    st.sampled_from(["6.25 mm", "112 deg", "0.3", "A trial"]),
)
def test_no_value_gives_anything_but_a_scenario_error(value, old):
    try:
        load_text(GOOD.replace(old, value), "my.yaml")
    except ScenarioError as error:
        line = str(error)
    else:
        line = ""
    assert line.isprintable()

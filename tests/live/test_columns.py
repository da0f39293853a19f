"""Tables of any program on the live page: their columns as a person says them, against the numbers that were written."""

import base64

import numpy as np
import pytest

T = np.arange(30) / 60
LIGHT = np.column_stack([-0.3 + 0.5 * T**2, 0.2 - 4.9 * T**2])
HEAVY = np.column_stack([0.01 + 0 * T, -0.2 - 2.0 * T**2])
BOTH = {"light_x": LIGHT[:, 0], "light_y": LIGHT[:, 1], "heavy_x": HEAVY[:, 0], "heavy_y": HEAVY[:, 1]}
ALL = ["t", *BOTH]


def written(head, columns, *, delimiter=",", comma=False, digits=9):
    """Return a table as a program would write it."""
    rows = [[f"{value:.{digits}f}" for value in row] for row in np.column_stack(columns)]
    return "\n".join([*head, *(delimiter.join(row).replace(".", "," if comma else ".") for row in rows)]) + "\n"


GERMAN = "Zeit in s; Masse A x in cm; Masse A y in cm; Masse B x in cm; Masse B y in cm"
NAMED = "Zeit [s];leicht x [cm];leicht y [cm];schwer x [cm];schwer y [cm]"
CM = [T, *(100 * value for value in BOTH.values())]
TABLES = {
    "German headings, semicolons and commas": (
        written([GERMAN], CM, delimiter="; ", comma=True),
        ALL,
        ["t", "", "", "", ""],
    ),
    "lines above the headings": (
        written(["Versuch 3", "14.11.2026; Klasse 10b", NAMED], CM, delimiter=";"),
        None,
        ALL,
    ),
    "time in the midst": (
        written(["M1 x (m)\tM1 y (m)\tZeit (ms)\tM2 x (m)\tM2 y (m)"], [*LIGHT.T, 1e3 * T, *HEAVY.T], delimiter="\t"),
        None,
        ["light_x", "light_y", "t", "heavy_x", "heavy_y"],
    ),
    "aligned by spaces, without headings": (written([], [T, *LIGHT.T, *HEAVY.T], delimiter="   "), ALL, ["", "", "", "", ""]),
    "one thing": (written(["seconds,pos x [mm],pos y [mm]"], [T, *(1e3 * LIGHT.T)]), None, ["t", "light_x", "light_y"]),
    "with a column that is not asked for": (
        written(["t (s),speed,x_cm,y_cm"], [T, 0 * T + 3, *(100 * LIGHT.T)]), None, ["t", "", "light_x", "light_y"],
    ),
}  # fmt: skip
"""What a program wrote, what a person says of it (None: the guess is right), and the guess."""


def coded(text):
    return base64.b64encode(text.encode()).decode()


@pytest.fixture(scope="module")
def read(node):
    """Split and read tables: a text and, if they are said, its roles and units."""
    return lambda *files: node("split_columns.mjs", [{"bytes": coded(f[0]), "roles": f[1], "options": f[2]} for f in files])


def test_each_table_is_read_as_its_person_says(read):
    found = read(*((text, roles, {}) for text, roles, _ in TABLES.values()))
    for (name, (_, roles, guess)), result in zip(TABLES.items(), found, strict=True):
        assert result["guess"] == guess, name
        assert result["others"] == 0, name
        channels = {channel["name"]: channel for channel in result["channels"]}
        assert channels.keys() == {role for role in roles or guess if role not in ("", "t")}, name
        for channel in channels.values():
            assert channel["t"] == pytest.approx(T, abs=1e-9), name
            assert channel["value"] == pytest.approx(BOTH[channel["name"]], abs=1e-8), name


def test_what_was_read_is_read_again_from_its_plain_table(read):
    for result in read(*((text, roles, {}) for text, roles, _ in TABLES.values())):
        assert result["again"] == result["channels"]


def test_units_that_no_heading_states_are_those_of_the_page(read):
    text = written([], [1e3 * T, *(100 * LIGHT.T)], delimiter=" ")
    [result] = read((text, ["t", "light_x", "light_y"], {"units": {"length": "cm", "time": "ms"}}))
    assert result["channels"][0]["t"] == pytest.approx(T, abs=1e-9)
    assert result["channels"][0]["value"] == pytest.approx(LIGHT[:, 0], abs=1e-9)


def test_lines_that_are_left_out_are_counted_and_bad_cells_refused(read):
    table = written(["Zeit;x;y"], [T, *LIGHT.T], delimiter=";")
    lines = table.splitlines()
    left, bad = read(
        ("\n".join([*lines[:9], "Pause", *lines[9:], "Ende"]), ["t", "light_x", "light_y"], {}),
        ("\n".join([*lines[:9], f"{T[8]:.9f};0.1;oops", *lines[10:]]), ["t", "light_x", "light_y"], {}),
    )
    assert left["others"] == 2
    assert len(left["channels"][0]["t"]) == len(T)
    assert bad["message"].startswith("clip.csv:10: column 'light_y': found 'oops', needed a number")


def test_what_is_no_table_is_none(read):
    assert (
        read(("not a table", None, {}), ("<?xml version='1.0'?>\n<a/>", None, {}), ("1,2\n", None, {}), ("", None, {}))
        == [None] * 4
    )

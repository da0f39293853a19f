"""Each recipe for a rope over a rod, run as a stranger would, and the page that compares them."""

import pytest

from looping_pendulum.cli.common import recipe_engine_names
from looping_pendulum.repro.claims import RECIPES, all_claims
from scripts.rope_page import PAGE, page
from tests.command_line import here
from tests.stranger import (
    MODULES,
    accurate_if_slow,
    assert_as_its_head_says,
    assert_stands_alone,
    printed,
    run,
    skip_unless_installed,
    written,
)

RECIPES_BY_FILE = {recipe.file_name: recipe for recipe in all_claims(RECIPES)}
PRINTED = (
    r"closed form (\S+)(| \S+), reached within (\S+)\2\n"
    r"observed (\S+)\2 with (\S+) (\S+): the recipe (holds|fails)\n"
)
REFINED = [
    ("mujoco_capstan", [("ANGLE = 1e-4", "ANGLE = 2e-5")], 0.06),
    ("mujoco_drum", [("HEAVY = 1e-3", "HEAVY = 1e-4")], 2e-3),
    ("mujoco_beads", [("BEAD = 1e-5, 11, 12", "BEAD = 2.5e-6, 16, 17"), ("2e-4 * LIGHT", "1e-4 * LIGHT")], 0.004),
    ("pymunk_chain", [("SLOP = 1e-5, 11, 12", "SLOP = 2.5e-6, 16, 17"), ("2e-4 * LIGHT", "5e-5 * LIGHT")], 0.007),
    ("pymunk_segments", [("MASS = 1e-5", "MASS = 2e-6")], 0.011),
    ("pybullet_chain", [("NODE = 2e-5, 11, 12", "NODE = 5e-6, 16, 17")], 0.015),
    ("rapier_chain", [("1e-5, 32, 11, 12", "1e-5, 64, 16, 17")], 0.002),
    ("exudyn_cable", [("1e-4, 10, 6, 4", "1e-4, 16, 9, 4")], 0.016),
    ("newton_tendon", [("1e-5, 1e-4, 2.0, 1e-3", "4e-6, 2e-5, 3.0, 1e-3")], 0.005),
    ("box2d_chain", [("SECOND = 1e-5, 11, 12", "SECOND = 2.5e-6, 11, 12"), ("2e-4 * LIGHT", "5e-5 * LIGHT")], 0.003),
]
"""Recipe, finer settings, and the error that remains with them, measured and rounded up by a fifth, in the recipe's unit."""


@pytest.mark.parametrize(
    "recipe",
    [pytest.param(recipe, id=name, marks=accurate_if_slow(recipe.engine)) for name, recipe in RECIPES_BY_FILE.items()],
)
def test_a_recipe_reaches_what_its_head_says(recipe, tmp_path):
    skip_unless_installed(recipe.engine)
    done = run(written(recipe, tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert_as_its_head_says(recipe, PRINTED, done)


@pytest.mark.parametrize("recipe", RECIPES_BY_FILE.values(), ids=RECIPES_BY_FILE)
def test_a_recipe_stands_alone(recipe):
    assert_stands_alone(recipe)
    assert recipe.name == recipe.variant
    assert abs(recipe.observed - recipe.expected) + recipe.spread < recipe.limit  # no last bit decides whether it holds


@pytest.mark.accurate
@pytest.mark.parametrize(("name", "changes", "error"), REFINED, ids=[name for name, *_ in REFINED])
def test_finer_settings_come_nearer(name, changes, error, tmp_path):
    recipe = RECIPES_BY_FILE[f"{name}.py"]
    skip_unless_installed(recipe.engine)
    source = recipe.source
    for old, new in changes:
        assert old in source
        source = source.replace(old, new)
    assert float(printed(PRINTED, run(written(recipe, tmp_path, source)))[3]) == pytest.approx(recipe.expected, abs=error)


def test_a_recipe_that_misses_says_so(tmp_path):
    recipe = RECIPES_BY_FILE["mujoco_drum.py"]
    skip_unless_installed(recipe.engine)
    broken = recipe.source.replace("MU, R, FREE, ANGLE, HEAVY = 1e-3, 0.3431", "MU, R, FREE, ANGLE, HEAVY = 1e-3, 0.2")
    assert broken != recipe.source
    done = run(written(recipe, tmp_path, broken))
    assert (done.returncode, printed(PRINTED, done)[-1]) == (1, "fails")


def test_every_engine_has_a_recipe():
    assert len(RECIPES_BY_FILE) >= 11
    assert recipe_engine_names() == sorted(MODULES) == sorted({recipe.engine for recipe in RECIPES_BY_FILE.values()})


def test_the_command_lists_and_writes_a_recipe(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    listed = here("recipe", "pymunk").stdout.splitlines()
    assert [line.split()[0] for line in listed] == ["chain", "segments"]
    done = here("recipe", "pymunk", "--variant", "chain")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "pymunk_chain.py").read_text(encoding="utf-8") == RECIPES_BY_FILE["pymunk_chain.py"].source
    again = here("recipe", "pymunk", "--variant", "chain")
    assert again.returncode == 2
    assert "found a file, which is left as it is" in again.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["bullet"], "choose one of box2d, drake, exudyn, mujoco, newton, pybullet, pymunk, rapier"),
        (["pymunk", "--variant", "nope"], "choose one of chain, segments"),
        (["pymunk", "--out", "rope.py"], "--out: found it without --variant"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_choices(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = here("recipe", *arguments)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert message in done.stderr


def test_the_page_is_what_the_stored_numbers_and_the_recipes_say():
    assert PAGE.read_text(encoding="utf-8") == page(), "out of date; write it again: python -m scripts.rope_page"

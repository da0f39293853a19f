"""Ask for a scenario, and write its YAML; the text is loaded before it is returned, so it is always valid."""

from __future__ import annotations

from collections.abc import Iterable

import yaml

from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import keys_below, suggest
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.scenarios.schema import file_model
from looping_pendulum.teaching.questions import (
    QUESTIONS,
    RELEASES,
    AnswerError,
    Answers,
    Tree,
    check_quantity,
    check_release,
    check_text,
    get,
    put,
    yaml_text,
)

SCENARIO_HEAD = """\
# Every number carries its unit. Angles are those of the string to the light mass: 0 deg is straight up, 90 deg is level,
# 180 deg is straight down. Change a number, save, and run it again: looping-pendulum run THIS_FILE
"""
STATIC_FRICTION_KEY = "string.static_friction"
NOT_ASKED = {Release.VERTICAL: ("release.angle",), Release.HELD: ("string.kinetic_friction", STATIC_FRICTION_KEY, "heavy.drag")}
"""Release -> keys of the questions that have no meaning for it."""
COPIED_KEYS = ("gravity", "light.radius", "effects")
"""Keys that are not asked for, but copied from the scenario that supplies the defaults, if it has them."""


def new_scenario(answer: Answers, *, name: str, like: str) -> tuple[str, Scenario]:
    """Ask for a scenario.

    Parameters
    ----------
    answer
        How to ask, and what was answered beforehand; further keys of a scenario file among that are copied.
    name
        Name of the scenario, for error messages and the default title.
    like
        Shipped scenario, or file, whose numbers are the defaults.

    Returns
    -------
    text : str
        YAML of the file.
    scenario : Scenario
        The scenario that the file loads to.

    Raises
    ------
    AnswerError
        If an answer was given to a question that there is not.
    ScenarioError
        If the answers contradict each other.
    """
    _refuse_unknown_keys(answer.unused)
    defaults, usual = scenario_tree(like), scenario_tree("ten_to_one")
    tree: Tree = {"title": answer("title", "Title, a few words", name.replace("_", " "), check_text)}
    for key in COPIED_KEYS:
        if (value := get(defaults, key)) is not None:
            put(tree, key, value)
    kinds = "; ".join(f"{kind}: {words}" for kind, words in RELEASES.items())
    kind = answer("release.kind", f"Kind of release ({kinds})", get(defaults, "release.kind"), check_release)
    for key, question in QUESTIONS.items():
        if key in NOT_ASKED.get(Release(kind), ()):
            continue
        if key == STATIC_FRICTION_KEY and get(defaults, key) in (None, get(defaults, "string.kinetic_friction")):
            continue  # one coefficient is enough where the defaults are from; the file takes the kinetic one for both
        default = get(defaults, key)
        # The scenario ``like`` may have no number for a question, as a vertical release has no angle
        default = get(usual, key) if default is None else default
        put(tree, key, answer(key, question.question, str(default), check_quantity(question)))
    put(tree, "release.kind", kind)
    for key, value in answer.unused.items():
        put(tree, key, value)
    text = SCENARIO_HEAD + yaml_text(tree, ("title", "light", "heavy", "rod", "string", "gravity", "release", "duration"))
    return text, loader.load_text(text, f"{name}.yaml")


def _refuse_unknown_keys(given: Iterable[str]) -> None:
    """Refuse answers to questions that there are not, before any is asked."""
    for key in tuple(given):
        *group, last = key.split(".")
        known = keys_below(file_model(), tuple(group))
        if last not in known:
            way_out = f"needed one of: {', '.join(known)}" if known else "which no scenario has; docs/keys.md lists all keys"
            raise AnswerError(f"--set: found the key {quote(key)}, {way_out}{suggest(last, known)}", keys=(key,))


def expected_motion(scenario: Scenario) -> str:
    """Return one line on the motion that the exact reference predicts."""
    run = solve(scenario.parameters, duration=max(DURATION, scenario.duration))
    if scenario.parameters.release in (Release.HELD, Release.DROP):
        return f"The reference ends it after {run.end_time:.2f} s ({run.end.event})."
    if run.halt is None:
        return f"The reference says: the heavy mass never halts; the run ends after {run.end_time:.2f} s ({run.end.event})."
    fallen = float(run.heavy_drop(run.halt.state))
    return f"The reference says: the heavy mass falls {100 * fallen:.1f} cm and halts after {run.halt.time:.3f} s."


def scenario_tree(scenario: str) -> Tree:
    """Return the content of a scenario's file."""
    tree: Tree = yaml.safe_load(loader.dump(loader.load(scenario)))
    return tree

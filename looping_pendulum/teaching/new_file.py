"""A scenario or a study, written by asking. What is written has been loaded, so it is never a file that the program refuses."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from looping_pendulum.discrepancy.data import readers, study_io
from looping_pendulum.discrepancy.data.observations import DataError
from looping_pendulum.discrepancy.data.study_file import FREE_STARTS
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.scenarios.schema import suggest
from looping_pendulum.teaching.questions import QUESTIONS, RELEASES, AnswerError, Ask, check_release, check_text

Tree = dict[str, Any]

SCENARIO_HEAD = """\
# Every number carries its unit. Angles are those of the string to the light mass: 0 deg is straight up, 90 deg is level,
# 180 deg is straight down. Change a number, save, and run it again: looping-pendulum run THIS_FILE
"""
STUDY_HEAD = """\
# "+/-" is the standard error of what was measured; "free" is what nobody knows. Then: looping-pendulum identify THIS_FILE
"""
STATIC = "string.static_friction"
NOT_ASKED = {Release.VERTICAL: ("release.angle",), Release.HELD: ("string.kinetic_friction", STATIC, "heavy.drag")}
"""Release -> questions that mean nothing for it."""
KEPT = ("gravity", "light.radius", "effects")
"""Not asked for, but kept where the scenario that the defaults are from has them."""
DECLARED = "capstan, light_drag, heavy_drag"
"""Effects that most experimenters believe in, beside gravity."""
ERRORS = {
    "light.mass": "0.5 %",
    "heavy.mass": "0.5 %",
    "rod.radius": "1 %",
    "release.angle": "0.5 deg",
    "release.free_length": "1 mm",
    "release.hanging_length": "1 mm",
}
"""Key -> the error that a kitchen scale, a ruler and a protractor leave."""


def new_scenario(ask: Ask, *, name: str, like: str, given: Mapping[str, str]) -> tuple[str, Scenario]:
    """Ask for a scenario.

    Parameters
    ----------
    ask
        How to ask; see `questions.Ask`.
    name
        Of the scenario, for errors and the default title.
    like
        Shipped scenario, or file, whose numbers are the defaults.
    given
        Key -> answer that is not asked for, "light.mass" -> "12 g"; other keys of a scenario file are written as they are.

    Returns
    -------
    text : str
        YAML.
    scenario : Scenario
        What it loads to.

    Raises
    ------
    ScenarioError
        If the answers are impossible together.
    """
    pattern, usual = _written(like), _written("ten_to_one")
    answer = _Answers(ask, given)
    tree: Tree = {"title": answer("title", "Title, a few words", name.replace("_", " "), check_text)}
    for key in KEPT:
        if (value := _at(pattern, key)) is not None:
            _put(tree, key, value)
    kinds = "; ".join(f"{kind}: {words}" for kind, words in RELEASES.items())
    kind = answer("release.kind", f"Kind of release ({kinds})", _at(pattern, "release.kind"), check_release)
    for key, question in QUESTIONS.items():
        if key in NOT_ASKED.get(Release(kind), ()):
            continue
        if key == STATIC and _at(pattern, key) in (None, _at(pattern, "string.kinetic_friction")):
            continue  # one coefficient is enough where the defaults are from; the file takes the kinetic one for both
        default = _at(pattern, key)
        default = _at(usual, key) if default is None else default
        _put(tree, key, answer(key, question.words, str(default), question.check))
    _put(tree, "release.kind", kind)
    for key, value in answer.left.items():
        _put(tree, key, value)
    text = SCENARIO_HEAD + _yaml(tree, ("title", "light", "heavy", "rod", "string", "gravity", "release", "duration"))
    return text, loader.load_text(text, f"{name}.yaml")


def outlook(scenario: Scenario) -> str:
    """One line on what the exact reference says will happen."""
    run = solve(scenario.parameters, duration=max(DURATION, scenario.duration))
    if scenario.parameters.release in (Release.HELD, Release.DROP):
        return f"The reference ends it after {run.end_time:.2f} s ({run.end.event})."
    if run.halt is None:
        return f"The reference says: the heavy mass never halts; the run ends after {run.end_time:.2f} s ({run.end.event})."
    fallen = float(run.heavy_drop(run.halt.state))
    return f"The reference says: the heavy mass falls {100 * fallen:.1f} cm and halts after {run.halt.time:.3f} s."


def new_study(ask: Ask, *, name: str, folder: Path, files: Sequence[str], given: Mapping[str, str], like: str) -> str:
    """Ask for a study of filmed trials.

    Parameters
    ----------
    folder
        Where the study file will stand; paths of the trials are written from there.
    files
        The trials' files, from the current folder; none: they are asked for.

    Returns
    -------
    str
        YAML that loads.

    Raises
    ------
    StudyError
        If the answers are impossible together.
    """
    for file in files:
        if not Path(file).exists():
            raise AnswerError(f"--trial: found no file {quote(file)}, needed the file of a trial's marks; correct the path")
    pattern = _written(like)
    answer = _Answers(ask, given)
    tree: Tree = {"title": answer("title", "Title, a few words", name.replace("_", " "), check_text), "apparatus": {}}
    for key in ("light.mass", "rod.radius"):
        _put(tree["apparatus"], key, answer.measured(key, key, pattern))
    believed = answer("effects", "Effects that you believe act, beside gravity", DECLARED, check_effects)
    tree["effects"] = {"gravity": "9.81 m/s^2"} | {effect: "free" for effect in _listed(believed)}
    count = len(files) or int(answer("count", "How many trials were filmed", "2", _check_count))
    tree["trials"] = [_trial(answer, i, count, files[i] if files else "", folder=folder, pattern=pattern) for i in range(count)]
    for key in answer.left:
        raise AnswerError(f"--set: found {key!r}, which is not asked for; ask for the file and change it there")
    text = STUDY_HEAD + _yaml(tree, ("title", "apparatus", "effects", "trials"))
    study_io.load_text(text, f"{name}.yaml", folder)
    return text


def _trial(answer: _Answers, index: int, count: int, file: str, *, folder: Path, pattern: Tree) -> Tree:
    """Ask for one trial."""
    at, first = f"trials.{index + 1}", index == 0
    tracks = {
        mass: answer(f"{at}.{mass}_track", f"Trial {index + 1}: name of the {mass} mass's track in Tracker", mass, check_text)
        for mass in ("light", "heavy")
    }

    def check_file(path: str) -> str:
        return check_marks(path, tracks)

    path = file
    if file:
        check_file(file)
    else:
        path = answer(f"{at}.file", f"Trial {index + 1}: file of its marks", f"trial{index + 1}.csv", check_file)
    tree: Tree = {"name": Path(path).stem, "file": Path(os.path.relpath(path, folder)).as_posix(), "tracks": tracks}
    held_out = "no" if count == 1 or index < count - 1 else "yes"
    asked = f"Trial {index + 1}: keep it away from the fit, to judge the verdict on"
    if answer(f"{at}.held_out", asked, held_out, _check_yes) == "yes":
        tree["held_out"] = "true"
    keys = ("heavy.mass", "release.angle", "release.free_length", "release.hanging_length")
    for key in keys:
        before = None if first else answer.last.get(key)
        _put(tree, key, answer.measured(f"{at}.{key}", key, pattern, before, lead=f"Trial {index + 1}: "))
    return tree


def check_marks(path: str, tracks: Mapping[str, str]) -> str:
    """Read a file of marks; a file that is not there yet is only warned of.

    Raises
    ------
    AnswerError
        If it is there and cannot be used.
    """
    if not Path(path).exists():
        return f"{path} is not there yet; put it there before `identify`"
    try:
        return readers.read(path, tracks=tracks).summary()
    except DataError as error:
        raise AnswerError(str(error)) from None


def check_effects(answer: str) -> str:
    """Accept names of effects, separated by commas.

    Raises
    ------
    AnswerError
        If one is unknown, or has no value to start from.
    """
    for effect in _listed(answer):
        if effect not in EFFECTS:
            raise AnswerError(
                f"found an unknown effect '{effect}', needed some of: {', '.join(EFFECTS)}{suggest(effect, EFFECTS)}"
            )
        first = EFFECTS[effect].coefficients[0]
        if effect != "gravity" and first.name not in FREE_STARTS and first.default != first.null:
            raise AnswerError(f"found '{effect}', which has no value to start from; add it to the file by hand")
    return ""


def _listed(answer: str) -> list[str]:
    return [effect for part in answer.split(",") if (effect := part.strip()) and effect != "gravity"]


def _check_count(answer: str) -> str:
    if not (answer.isascii() and answer.isdigit() and 0 < int(answer) <= 20):
        raise AnswerError(f"expected a whole number from 1 to 20, got '{answer}'")
    return "with a single trial, blocks of time are held out; a second trial tells more" if answer == "1" else ""


def _check_yes(answer: str) -> str:
    if answer not in ("yes", "no"):
        raise AnswerError(f"expected yes or no, got '{answer}'")
    return ""


class _Answers:
    """Asks, unless an answer was given beforehand, which is checked all the same."""

    def __init__(self, ask: Ask, given: Mapping[str, str]) -> None:
        self._ask = ask
        self.left = dict(given)
        self.last: dict[str, str] = {}
        """Key of a scenario -> last answer that was measured."""

    def __call__(self, key: str, words: str, default: str, check: Any) -> str:
        if key not in self.left:
            return self._ask(words, default, check)
        given = self.left.pop(key)
        try:
            check(given)
        except AnswerError as error:
            raise AnswerError(f"--set {key}: {error}") from None
        return given

    def measured(self, key: str, question: str, pattern: Tree, before: str | None = None, lead: str = "") -> str:
        """Ask for a number with its error."""
        asked = QUESTIONS[question]
        default = before or f"{_at(pattern, question)} +/- {ERRORS[question]}"
        self.last[question] = self(key, lead + asked.words, default, asked.check_measured)
        return self.last[question]


def _written(scenario: str) -> Tree:
    """A scenario as its file's tree."""
    tree: Tree = yaml.safe_load(loader.dump(loader.load(scenario)))
    return tree


def _at(tree: Tree, key: str) -> Any:
    value: Any = tree
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value


def _put(tree: Tree, key: str, value: str) -> None:
    *groups, last = key.split(".")
    for group in groups:
        tree = tree.setdefault(group, {})
    tree[last] = value


def _yaml(tree: Tree, order: Sequence[str]) -> str:
    ordered = {key: tree[key] for key in order if key in tree} | tree
    return str(yaml.dump(_plain(ordered), Dumper=yaml.SafeDumper, sort_keys=False, allow_unicode=True, width=100))


def _plain(value: Any) -> Any:
    """Numbers and flags instead of their text, which YAML would put in quotes."""
    if isinstance(value, dict):
        return {key: inner if key in ("title", "name", "file") else _plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    if value in ("true", "false"):
        return value == "true"
    try:
        return float(value)
    except ValueError:
        return value

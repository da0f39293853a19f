"""Ask for a scenario or a study, and write its YAML; the text is loaded before it is returned, so it is always valid."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from looping_pendulum.discrepancy.data import readers, study_io
from looping_pendulum.discrepancy.data.observations import DataError
from looping_pendulum.discrepancy.data.study_fields import FREE_STARTS
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import suggest
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.questions import QUESTIONS, RELEASES, AnswerError, Ask, check_release, check_text

Tree = dict[str, Any]

SCENARIO_HEAD = """\
# Every number carries its unit. Angles are those of the string to the light mass: 0 deg is straight up, 90 deg is level,
# 180 deg is straight down. Change a number, save, and run it again: looping-pendulum run THIS_FILE
"""
STUDY_HEAD = """\
# "+/-" is the standard error of what was measured; "free" is what nobody knows. Then: looping-pendulum identify THIS_FILE
"""
STATIC_FRICTION_KEY = "string.static_friction"
NOT_ASKED = {Release.VERTICAL: ("release.angle",), Release.HELD: ("string.kinetic_friction", STATIC_FRICTION_KEY, "heavy.drag")}
"""Release -> keys of the questions that have no meaning for it."""
COPIED_KEYS = ("gravity", "light.radius", "effects")
"""Keys that are not asked for, but copied from the scenario that supplies the defaults, if it has them."""
USUAL_EFFECTS = "capstan, light_drag, heavy_drag"
"""Default of the effects that a study declares, beside gravity: those that most experimenters expect."""
USUAL_ERRORS = {
    "light.mass": "0.5 %",
    "heavy.mass": "0.5 %",
    "rod.radius": "1 %",
    "release.angle": "0.5 deg",
    "release.free_length": "1 mm",
    "release.hanging_length": "1 mm",
}
"""Key -> default of its standard error, as measured with a kitchen scale, a ruler and a protractor."""


def new_scenario(ask: Ask, *, name: str, like: str, given: Mapping[str, str]) -> tuple[str, Scenario]:
    """Ask for a scenario.

    Parameters
    ----------
    ask
        How to ask; see `questions.Ask`.
    name
        Name of the scenario, for error messages and the default title.
    like
        Shipped scenario, or file, whose numbers are the defaults.
    given
        Key -> answer of a question that is then not asked, "light.mass" -> "12 g"; further keys of a scenario file are copied.

    Returns
    -------
    text : str
        YAML of the file.
    scenario : Scenario
        The scenario that the file loads to.

    Raises
    ------
    ScenarioError
        If the answers contradict each other.
    """
    defaults, usual = _scenario_tree(like), _scenario_tree("ten_to_one")
    answer = _Answers(ask, given)
    tree: Tree = {"title": answer("title", "Title, a few words", name.replace("_", " "), check_text)}
    for key in COPIED_KEYS:
        if (value := _get(defaults, key)) is not None:
            _set(tree, key, value)
    kinds = "; ".join(f"{kind}: {words}" for kind, words in RELEASES.items())
    kind = answer("release.kind", f"Kind of release ({kinds})", _get(defaults, "release.kind"), check_release)
    for key, question in QUESTIONS.items():
        if key in NOT_ASKED.get(Release(kind), ()):
            continue
        if key == STATIC_FRICTION_KEY and _get(defaults, key) in (None, _get(defaults, "string.kinetic_friction")):
            continue  # one coefficient is enough where the defaults are from; the file takes the kinetic one for both
        default = _get(defaults, key)
        # The scenario ``like`` may have no number for a question, as a vertical release has no angle
        default = _get(usual, key) if default is None else default
        _set(tree, key, answer(key, question.text, str(default), question.check))
    _set(tree, "release.kind", kind)
    for key, value in answer.unused.items():
        _set(tree, key, value)
    text = SCENARIO_HEAD + _yaml(tree, ("title", "light", "heavy", "rod", "string", "gravity", "release", "duration"))
    return text, loader.load_text(text, f"{name}.yaml")


def expected_motion(scenario: Scenario) -> str:
    """Return one line on the motion that the exact reference predicts."""
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
        Folder of the study file; the trials' paths are written relative to it.
    files
        The trials' files, relative to the current folder; if empty, they are asked for.

    Returns
    -------
    str
        YAML of the file.

    Raises
    ------
    StudyError
        If the answers contradict each other.
    """
    for file in files:
        if not Path(file).exists():
            raise AnswerError(f"--trial: found no file {quote(file)}, needed the file of a trial's marks; correct the path")
    defaults = _scenario_tree(like)
    answer = _Answers(ask, given)
    tree: Tree = {"title": answer("title", "Title, a few words", name.replace("_", " "), check_text), "apparatus": {}}
    for key in ("light.mass", "rod.radius"):
        _set(tree["apparatus"], key, answer.measured(key, key, defaults))
    declared_effects = answer("effects", "Effects that you believe act, beside gravity", USUAL_EFFECTS, check_effects)
    tree["effects"] = {"gravity": "9.81 m/s^2"} | {effect: "free" for effect in _split_effects(declared_effects)}
    count = len(files) or int(answer("count", "How many trials were filmed", "2", _check_count))
    tree["trials"] = [
        _trial(answer, i, count, files[i] if files else "", folder=folder, defaults=defaults) for i in range(count)
    ]
    for key in answer.unused:
        raise AnswerError(f"--set: found {key!r}, which is not asked for; ask for the file and change it there")
    text = STUDY_HEAD + _yaml(tree, ("title", "apparatus", "effects", "trials"))
    # Loaded for its errors alone: contradictions between answers show here, before the file is written
    study_io.load_text(text, f"{name}.yaml", folder)
    return text


def _trial(answer: _Answers, index: int, count: int, file: str, *, folder: Path, defaults: Tree) -> Tree:
    """Ask for one trial."""
    at, first = f"trials.{index + 1}", index == 0
    tracks = {
        mass: answer(f"{at}.{mass}_track", f"Trial {index + 1}: name of the {mass} mass's track in Tracker", mass, check_text)
        for mass in ("light", "heavy")
    }

    def check_file(path: str) -> str:
        return check_tracked_points(path, tracks)

    path = file
    if file:
        check_file(file)
    else:
        path = answer(f"{at}.file", f"Trial {index + 1}: file of its marks", f"trial{index + 1}.csv", check_file)
    # With forward slashes, so that the study also loads on another system
    tree: Tree = {"name": Path(path).stem, "file": Path(os.path.relpath(path, folder)).as_posix(), "tracks": tracks}
    held_out = "no" if count == 1 or index < count - 1 else "yes"
    asked_question = f"Trial {index + 1}: keep it away from the fit, to judge the verdict on"
    if answer(f"{at}.held_out", asked_question, held_out, _check_yes_or_no) == "yes":
        tree["held_out"] = "true"
    keys = ("heavy.mass", "release.angle", "release.free_length", "release.hanging_length")
    for key in keys:
        before = None if first else answer.last_measured.get(key)
        _set(tree, key, answer.measured(f"{at}.{key}", key, defaults, before, lead=f"Trial {index + 1}: "))
    return tree


def check_tracked_points(path: str, tracks: Mapping[str, str]) -> str:
    """Read a file of tracked points; return its summary, or a warning if it does not exist yet.

    Raises
    ------
    AnswerError
        If it exists and cannot be used.
    """
    if not Path(path).exists():
        return f"{path} is not there yet; put it there before `identify`"
    try:
        return readers.read(path, tracks=tracks).summary()
    except DataError as error:
        raise AnswerError(str(error)) from None


def check_effects(answer: str) -> str:
    """Check names of effects, separated by commas.

    Raises
    ------
    AnswerError
        If one is unknown, or has no value to start from.
    """
    for effect in _split_effects(answer):
        if effect not in EFFECTS:
            raise AnswerError(
                f"found an unknown effect '{effect}', needed some of: {', '.join(EFFECTS)}{suggest(effect, EFFECTS)}"
            )
        first = EFFECTS[effect].coefficients[0]
        if effect != "gravity" and first.name not in FREE_STARTS and first.default != first.null:
            raise AnswerError(f"found '{effect}', which has no value to start from; add it to the file by hand")
    return ""


def _split_effects(answer: str) -> list[str]:
    """Return the names of effects in an answer, without gravity, which every study has."""
    return [effect for part in answer.split(",") if (effect := part.strip()) and effect != "gravity"]


def _check_count(answer: str) -> str:
    if not (answer.isascii() and answer.isdigit() and 0 < int(answer) <= 20):
        raise AnswerError(f"expected a whole number from 1 to 20, got '{answer}'")
    return "with a single trial, blocks of time are held out; a second trial tells more" if answer == "1" else ""


def _check_yes_or_no(answer: str) -> str:
    if answer not in ("yes", "no"):
        raise AnswerError(f"expected yes or no, got '{answer}'")
    return ""


class _Answers:
    """Asks for answers, except for those that were given beforehand, which are checked in the same way."""

    def __init__(self, ask: Ask, given: Mapping[str, str]) -> None:
        self._ask = ask
        self.unused = dict(given)
        self.last_measured: dict[str, str] = {}
        """Key of a scenario -> the previous trial's answer to a question about a measurement."""

    def __call__(self, key: str, words: str, default: str, check: Any) -> str:
        if key not in self.unused:
            return self._ask(words, default, check)
        given = self.unused.pop(key)
        try:
            check(given)
        except AnswerError as error:
            raise AnswerError(f"--set {key}: {error}") from None
        return given

    def measured(self, key: str, question: str, defaults: Tree, before: str | None = None, lead: str = "") -> str:
        """Ask for a quantity with its standard error."""
        asked_question = QUESTIONS[question]
        default = before or f"{_get(defaults, question)} +/- {USUAL_ERRORS[question]}"
        self.last_measured[question] = self(key, lead + asked_question.text, default, asked_question.check_measured)
        return self.last_measured[question]


def _scenario_tree(scenario: str) -> Tree:
    """Return the content of a scenario's file."""
    tree: Tree = yaml.safe_load(loader.dump(loader.load(scenario)))
    return tree


def _get(tree: Tree, key: str) -> Any:
    """Return the value of a dotted key, or None."""
    value: Any = tree
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value


def _set(tree: Tree, key: str, value: str) -> None:
    """Set the value of a dotted key, adding the mappings that it needs."""
    *groups, last_measured = key.split(".")
    for group in groups:
        tree = tree.setdefault(group, {})
    tree[last_measured] = value


def _yaml(tree: Tree, order: Sequence[str]) -> str:
    ordered = {key: tree[key] for key in order if key in tree} | tree
    return str(yaml.dump(_plain(ordered), Dumper=yaml.SafeDumper, sort_keys=False, allow_unicode=True, width=100))


def _plain(value: Any) -> Any:
    """Convert texts of numbers and flags to numbers and flags, as YAML would put the texts in quotes."""
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

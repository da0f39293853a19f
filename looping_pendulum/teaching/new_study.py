"""Ask for a study of filmed trials, and write its YAML; what the trials' files say of themselves is not asked."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from looping_pendulum.measured import study_io
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.study import REQUIRED, Study
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import suggest
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.teaching.answers import Answers, Tree, get, put, yaml_text
from looping_pendulum.teaching.new_file import scenario_tree
from looping_pendulum.teaching.questions import QUESTIONS, AnswerError, check_measured, check_text
from looping_pendulum.teaching.trial_questions import TRIAL_KEYS, check_yes_or_no, trial_file

STUDY_HEAD = """\
# "+/-" is the standard error of what was measured; "free" is what nobody knows. Then: looping-pendulum identify THIS_FILE
"""
USUAL_EFFECTS = "capstan, light_drag, heavy_drag"
"""Default of the effects that a study declares, beside gravity: those that most experimenters expect."""
USUAL_EFFECTS_WITHOUT_ROD = {Release.HELD: "light_drag", Release.DROP: "heavy_drag"}
"""Release -> the same for a study of such trials alone."""
MEASURED_PER_TRIAL = {
    Release.LOOPING: ("heavy.mass", "release.angle", "release.free_length", "release.hanging_length"),
    Release.VERTICAL: ("heavy.mass", "release.free_length", "release.hanging_length"),
    Release.HELD: ("release.free_length",),
    Release.DROP: ("heavy.mass",),
}
"""Release -> keys of what is measured for each trial."""
APPARATUS = {"light.mass": "light_mass", "rod.radius": "rod_radius"}
"""Key of what is measured once for all trials -> parameter."""
STUDY_KEYS = ("title", "count", "effects", *APPARATUS)
"""Keys of the questions about the whole study."""
KEYS_OF_DATA = ("units", "frame_rate", "release")
"""Keys of a trial's questions that decide how its data compare with the motion."""
MAX_TRIALS = 20


def new_study(answer: Answers, *, name: str, folder: Path, files: Sequence[str], like: str) -> tuple[str, Study]:
    """Ask for a study of filmed trials.

    Parameters
    ----------
    answer
        How to ask, and what was answered beforehand.
    folder
        Folder of the study file; the trials' paths are written relative to it.
    files
        The trials' files, relative to the current folder; if empty, they are asked for.
    like
        Shipped scenario, or file, whose numbers are the defaults.

    Returns
    -------
    text : str
        YAML of the file.
    study : Study
        The study that the file loads to.

    Raises
    ------
    AnswerError
        If a file is not there or cannot be used, or if an answer was given to a question that there is not.
    StudyError
        If the answers contradict each other.
    """
    for file in files:
        if not Path(file).exists():
            raise AnswerError(f"--trial: found no file {quote(file)}, needed the file of a trial's marks; correct the path")
    _refuse_unknown_keys(answer)
    defaults = scenario_tree(like)
    tree: Tree = {"title": answer("title", "Title, a few words", name.replace("_", " "), check_text), "apparatus": {}}
    count = len(files) or int(answer("count", "How many trials were filmed", "2", check_count))
    trials: list[Tree] = []
    for i in range(count):
        trials.append(trial_file(answer, i, files[i] if files else "", trials))
    releases = {Release(get(trial, "release.kind") or Release.LOOPING) for trial in trials}
    for key, parameter in APPARATUS.items():
        if any(parameter in REQUIRED[release] for release in releases):
            put(tree["apparatus"], key, _measured(answer, key, key, defaults))
    only = next(iter(releases)) if len(releases) == 1 else Release.LOOPING
    usual_effects = USUAL_EFFECTS_WITHOUT_ROD.get(only, USUAL_EFFECTS)
    declared_effects = answer("effects", "Effects that you believe act, beside gravity", usual_effects, check_effects)
    tree["effects"] = {"gravity": "9.81 m/s^2"} | {effect: "free" for effect in _split_effects(declared_effects)}
    for i, trial in enumerate(trials):
        _measure_trial(answer, i, count, trial, defaults)
        # With forward slashes, so that the study also loads on another system
        trial["file"] = Path(os.path.relpath(trial["file"], folder)).as_posix()
    tree["trials"] = trials
    for key in answer.unused:
        raise AnswerError(f"--set: found {quote(key)}, which is not asked for in this study; leave it out", keys=(key,))
    text = STUDY_HEAD + yaml_text(tree, ("title", "apparatus", "effects", "trials"))
    # Loaded for contradictions between answers, which show here, before the file is written
    return text, study_io.load_text(text, f"{name}.yaml", folder)


def look_at_trials(study: Study) -> tuple[str, ...]:
    """Read the trials of a study as `identify` will, and return its warnings; none if a file is not there yet.

    Raises
    ------
    DataError
        If `identify` would refuse them.
    """
    # These import what fits, which takes a second
    from looping_pendulum.discrepancy.first_look.check import take_first_look
    from looping_pendulum.discrepancy.inputs import read_inputs

    if not all((study.folder / path).exists() for trial in study.trials for path, _ in trial.files):
        return ()
    # In the order of `identify`: a first look says more of lengths in pixels than that they are implausible
    check = take_first_look(study)
    check.refuse_mistakes()
    read_inputs(study, check.observations)
    return check.warnings


def not_measured(answer: Answers) -> list[str]:
    """Return the keys of the measurements that were asked for, of which nobody may have thought if defaults were taken."""
    return [key for key in answer.asked if key.endswith(tuple(q.key for q in QUESTIONS.values() if q.usual_error))]


def keys_of_fault(study: Study, fault: DataError) -> tuple[str, ...]:
    """Return the keys of the questions to ask again; empty: all of them.

    Those about one trial's data are enough if the fault names that trial, and no value of the apparatus.
    """
    from looping_pendulum.discrepancy.first_look.result import DeclarationError

    if isinstance(fault, DeclarationError) and not all(m.keys.startswith(KEYS_OF_DATA) for m in fault.check.mistakes):
        return ()  # a mass, a radius, a track
    index = next((i for i, trial in enumerate(study.trials, 1) if str(fault).startswith(f"trial {trial.name!r}:")), None)
    return () if index is None else tuple(f"trials.{index}.{key}" for key in KEYS_OF_DATA)


def _refuse_unknown_keys(answer: Answers) -> None:
    """Refuse answers to questions that there are not, before any is asked."""
    known = (*STUDY_KEYS, *(f"trials.1.{key}" for key in (*TRIAL_KEYS, "held_out", *MEASURED_PER_TRIAL[Release.LOOPING])))
    for key in tuple(answer.unused):
        if re.sub(r"^trials\.[1-9][0-9]?\.", "trials.1.", key) not in known:
            message = f"--set: found {quote(key)}, which is not asked for{suggest(key, known)}"
            raise AnswerError(f"{message}; ask for the file and change it there, as docs/keys.md says", keys=(key,))


def _measure_trial(answer: Answers, index: int, count: int, trial: Tree, defaults: Tree) -> None:
    """Ask for what was measured of one trial."""
    at = f"trials.{index + 1}"
    held_out = "no" if count == 1 or index < count - 1 else "yes"
    words = f"Trial {index + 1}: keep it away from the fit, to judge the verdict on"
    if answer(f"{at}.held_out", words, held_out, check_yes_or_no) == "yes":
        trial["held_out"] = "true"
    for key in MEASURED_PER_TRIAL[Release(get(trial, "release.kind") or Release.LOOPING)]:
        before = next((a for i in range(index, 0, -1) if (a := answer.known.get(f"trials.{i}.{key}"))), None)
        put(trial, key, _measured(answer, f"{at}.{key}", key, defaults, before, lead=f"Trial {index + 1}: "))


def _measured(answer: Answers, key: str, question: str, defaults: Tree, before: str | None = None, lead: str = "") -> str:
    """Ask for a quantity with its standard error; ``before`` is the answer for the trial before."""
    asked = QUESTIONS[question]
    usual = get(defaults, question) or get(scenario_tree("ten_to_one"), question)
    return answer(key, lead + asked.question, before or f"{usual} +/- {asked.usual_error}", check_measured(asked))


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
        has_start = first.name in QUANTITIES and QUANTITIES[first.name].free_start is not None
        if effect != "gravity" and not has_start and first.default != first.null:
            raise AnswerError(f"found '{effect}', which has no value to start from; add it to the file by hand")
    return ""


def _split_effects(answer: str) -> list[str]:
    """Return the names of effects in an answer, without gravity, which every study has."""
    return [effect for part in answer.split(",") if (effect := part.strip()) and effect != "gravity"]


def check_count(answer: str) -> str:
    """Check a number of trials.

    Raises
    ------
    AnswerError
        If it is no whole number, or too large.
    """
    if not (answer.isascii() and answer.isdigit() and 0 < int(answer) <= MAX_TRIALS):
        raise AnswerError(f"expected a whole number from 1 to {MAX_TRIALS}, got '{answer}'")
    return "with a single trial, blocks of time are held out; a second trial tells more" if answer == "1" else ""

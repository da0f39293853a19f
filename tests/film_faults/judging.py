"""Read a faulty study, take the first look and identify: were the points put right, or was the fault named?"""

import copy
import itertools
import re
import traceback
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.look.check import DeclarationCheck, take_first_look
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured import study_io
from looping_pendulum.measured.observations import Observations
from looping_pendulum.measured.study import read_files
from tests.film_faults.faults import KINDS, NONE, PLAIN, Faulty, nothing
from tests.film_faults.films import CHANNELS, Array, CleanStudy, Film, Tree, clean_study
from tests.film_faults.forms import as_written, table_text

RIGHT_WITHIN = 0.5
"""Largest distance of a point from where it should be, in standard deviations of the noise, that is right."""
MOVED_BY = 1.0
"""Distance in standard deviations beyond which a fault moves a point by more than the noise."""
MIN_SHARE_READ = 0.6
"""Smallest share of a channel's points that must be read: of a table with shifted cells, whole rows are left out."""
MAX_FOLLOWED = 4
"""Largest number of refusals of one trial whose way out is followed."""
IDENTIFY_LIMIT = 60.0
"""Longest search [s]: that for an unlisted force, in a fault that nobody named, takes minutes."""
USUAL_ASSUMPTION = " without a unit taken in "
"""What is said of every table without units."""
_KEYS = re.compile(r"'((?:tracks|units|run|frame_rate|clip_rate|mirrored|camera|release|light|heavy|rod): ?[^']*)'")
_WITHOUT_VALUE = re.compile(r"give 'frame_rate'|give the camera's 'frame_rate'")


class Outcome(StrEnum):
    """What became of a study with a fault."""

    RIGHT = "put right"
    NAMED = "named"
    HARMLESS = "harmless"
    SILENT = "silent misreading"
    LEFT_OUT = "points left out"
    MISNAMED = "another fault named"
    ALARM = "false alarm"
    NO_WAY_OUT = "way out is wrong"
    ADDED = "addition or tie"
    WARNED = "Python's warning"
    TRACEBACK = "traceback"

    @property
    def is_failure(self) -> bool:
        return self not in (Outcome.RIGHT, Outcome.NAMED, Outcome.HARMLESS)


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """One study with its fault, and what became of it."""

    number: int
    kind: str
    detail: str = ""
    outcome: Outcome
    message: str = ""
    """What was said, or what is wrong."""
    moved: float = 0.0
    """Largest distance by which the fault moves a point, as the table says it, in standard deviations of the noise."""
    verdict: str = ""
    """Of `identify`; empty: it was not asked, or refuses the study."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What was read of one trial, against what should be."""

    observations: Observations
    moved: float
    """Largest distance of a point from where it should be, in standard deviations of the noise."""
    share: float
    """Smallest share of a channel's points that were read."""
    is_exact: bool
    """Whether times and values are those of the table to the last digit."""


def make(number: int, kind: str) -> tuple[CleanStudy, Faulty]:
    """Return the clean study of a number, and that with a fault of a kind."""
    study = clean_study(number)
    put = nothing if kind == NONE else KINDS[kind]
    return study, put(np.random.default_rng([number, 3]), study)


def write(study: CleanStudy, faulty: Faulty, folder: Path) -> Path:
    """Write a study with its fault; return the study file."""
    folder.mkdir(parents=True, exist_ok=True)
    trials = []
    for film in faulty.films:
        (folder / f"{film.trial.name}.csv").write_text(table_text(film, faulty.form), encoding="utf-8")
        trial = film.entry | {"file": f"{film.trial.name}.csv", "tracks": faulty.form.tracks} | faulty.entry
        trials.append(trial)
    path = folder / "study.yaml"
    _dump(study.tree | {"trials": trials}, path)
    return path


def _dump(tree: Tree, path: Path) -> None:
    path.write_text(yaml.safe_dump(copy.deepcopy(tree), sort_keys=False, allow_unicode=True), encoding="utf-8")


def judge(number: int, kind: str, folder: Path, *, with_identify: bool = True) -> Judgement:
    """Put a fault in, and say what becomes of the study; files are written into the folder."""
    detail = ""
    try:
        study, faulty = make(number, kind)
        detail = faulty.detail
        path = write(study, faulty, folder)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = _judge(faulty, kind, path, with_identify=with_identify)
    except Exception as error:
        outcome = Outcome.WARNED if isinstance(error, Warning) else Outcome.TRACEBACK
        result = {"outcome": outcome, "message": "".join(traceback.format_exception(error))}
    return Judgement(number=number, kind=kind, detail=detail, **result)


def _judge(faulty: Faulty, kind: str, path: Path, *, with_identify: bool) -> dict[str, Any]:
    result: dict[str, Any] = {"moved": max(_moved_as_written(film, faulty) for film in faulty.films)}
    readings, refusals = _read(path, faulty)
    unnamed = next((r for r in refusals if not re.search(faulty.words, r)), None)
    if unnamed is not None:
        return result | {"outcome": Outcome.MISNAMED, "message": unnamed}
    if readings is None:
        return result | {"outcome": Outcome.NAMED, "message": refusals[-1]}
    asked = f"after the answer to: {refusals[-1]}; " if refusals else ""
    check = take_first_look(study_io.load(path))
    # What the first look has edited is what is fitted
    edited = [check.observations.get(film.trial.name) for film in faulty.films]
    readings = [
        reading if found is None else _reading(film, faulty, found)
        for film, found, reading in zip(faulty.films, edited, readings, strict=True)
    ]
    moved, share = max(r.moved for r in readings), min(r.share for r in readings)
    faults = [m.text for m in check.mistakes]
    said = [*check.warnings, *(e.reason for r in readings for e in r.observations.edits)]
    strange = next((text for text in faults if not re.search(faulty.words, text)), None)
    read = f"points up to {moved:.3g} sigma from where they should be, {share:.0%} read"
    if strange is not None:
        outcome = Outcome.ALARM if moved <= RIGHT_WITHIN else Outcome.MISNAMED
        return result | {"outcome": outcome, "message": f"{asked}{read}; {strange}"}
    if kind == NONE and (extra := _what_was_done(readings, check)):
        return result | {"outcome": Outcome.ALARM, "message": extra}
    if faults:
        result |= {"outcome": Outcome.NAMED, "message": faults[0]}
        if rest := _after_keys(path, check):
            return result | {"outcome": Outcome.NO_WAY_OUT, "message": f"{faults[0]} -> {rest}"}
        return result
    elif moved <= RIGHT_WITHIN and share >= MIN_SHARE_READ:
        # A refusal that asks for what the table leaves open has named it
        was = Outcome.NAMED if refusals else Outcome.RIGHT
        result |= {"outcome": was, "message": (refusals or ["; ".join(t for t in said if USUAL_ASSUMPTION not in t)])[-1]}
    elif moved <= RIGHT_WITHIN:
        return result | {"outcome": Outcome.LEFT_OUT, "message": f"{asked}{read}; {'; '.join(said)}"}
    elif any(re.search(faulty.said, text) for text in said):
        result |= {"outcome": Outcome.NAMED, "message": "; ".join(said)}
    elif moved <= MOVED_BY:
        result |= {"outcome": Outcome.HARMLESS, "message": read}
    else:
        outcome = Outcome.NO_WAY_OUT if refusals else Outcome.SILENT
        result |= {"outcome": outcome, "message": f"{asked}{read}; said: {'; '.join(said) or 'nothing'}"}
    if with_identify:
        result |= _identified(path, result)
    return result


def _read(path: Path, faulty: Faulty) -> tuple[list[Reading] | None, list[str]]:
    """Read all trials, following the way out of every refusal; the study file is rewritten with what was answered.

    Returns
    -------
    The readings, None if a way out is missing; and what was refused.
    """
    refusals: list[str] = []
    readings = []
    for number, film in enumerate(faulty.films):
        for _ in range(MAX_FOLLOWED):
            study = study_io.load(path)
            try:
                observations = read_files(study.folder, study.trials[number])
            except HarnessError as error:
                message = str(error)
                assert message.strip(), "a refusal says nothing"
                assert "\n" not in message, message
                refusals.append(message)
                if not _follow(path, number, message, film):
                    return None, refusals
                continue
            readings.append(_reading(film, faulty, observations))
            break
        else:
            return None, refusals
    return readings, refusals


def _follow(path: Path, number: int, message: str, film: Film) -> bool:
    """Put what a refusal asks for into the study; return whether there was anything new."""
    tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    trial = tree["trials"][number]
    before = copy.deepcopy(trial)
    for text in _KEYS.findall(message):
        _put(trial, text)
    if _WITHOUT_VALUE.search(message):
        trial["frame_rate"] = f"{film.rate:g} Hz"
    _dump(tree, path)
    return bool(trial != before)


def _put(place: Tree, text: str) -> bool:
    """Put a key that a message names into a part of a study; return whether it could be read."""
    try:
        tree = yaml.safe_load(text)
    except yaml.YAMLError:
        return False
    if not isinstance(tree, dict):
        return False
    for key, value in tree.items():
        place[key] = {**place.get(key, {}), **value} if isinstance(value, dict) and key != "tracks" else value
    return True


def _after_keys(path: Path, check: DeclarationCheck) -> str:
    """Return what still looks wrong after the keys of all mistakes were put into the study; '' if nothing, or without keys."""
    tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    rest = ""
    for alternatives in itertools.islice(itertools.product(*(m.keys.split("' or '") for m in check.mistakes)), 4):
        changed = copy.deepcopy(tree)
        for mistake, keys in zip(check.mistakes, alternatives, strict=True):
            for text in keys.split("' and '"):
                places = [t for t in changed["trials"] if t["name"] in mistake.trials]
                places = [changed["apparatus"]] if text.startswith("rod") else places
                if not text or not all([_put(place, text) for place in places]):
                    return ""
        other = path.with_name("with_keys.yaml")
        _dump(changed, other)
        try:
            after = take_first_look(study_io.load(other))
        except HarnessError as error:
            rest = f"with '{alternatives[0]}': {error}"
            continue
        if not after.mistakes:
            return ""
        rest = f"with '{alternatives[0]}': {after.mistakes[0].text}"
    return rest


def _what_was_done(readings: Sequence[Reading], check: DeclarationCheck) -> str:
    """Return what was done to a study without a fault; '' if nothing."""
    done = [a for r in readings for a in r.observations.assumptions if USUAL_ASSUMPTION not in a]
    done += [u.reason for r in readings for u in r.observations.unused if not u.reason.endswith(": empty cell")]
    done += check.warnings
    return (
        "; ".join(done) if done else "" if all(r.is_exact for r in readings) else "times or values are not those of the table"
    )


def _moved_as_written(film: Film, faulty: Faulty) -> float:
    """Return how far the table's own words move a point, in standard deviations."""
    if faulty.form.names != PLAIN.names:
        return float("inf")
    t, values = as_written(film, faulty.form)
    away = film.displaced(np.tile(t[:, None], (1, 4)), values)
    return float(np.nanmax(away))


def _reading(film: Film, faulty: Faulty, observations: Observations) -> Reading:
    """Compare what was read of a trial with its points."""
    found = {c.name: c for c in observations.channels}
    sigma = film.sigma(film.taken)
    moved, shares, late = [0.0], [], []
    t_written, written = as_written(film, faulty.form)
    is_exact = True
    matches = []
    for i, name in enumerate(CHANNELS):
        known = np.flatnonzero(np.isfinite(film.points[:, i]))
        if name not in found:
            shares.append(0.0)
            continue
        channel = found[name]
        expected = np.flatnonzero(np.isfinite(written[:, i]))
        is_exact &= len(channel) == len(expected) and bool(
            np.allclose(channel.t, t_written[expected], rtol=0, atol=1e-12)
            and np.allclose(channel.value, written[expected, i], rtol=0, atol=1e-12)
        )
        taken, points = film.taken[known, i], film.points[known, i]
        shares.append(len(channel) / len(np.unique(taken)))
        row, delay, away = _matched(channel.t, channel.value, taken, points, faulty.form.length_error)
        matches.append((i, known[row], delay, away, channel.time_error))
        late += delay[np.isfinite(delay)].tolist()
    offset = float(np.clip(np.median(late), -faulty.clock_offset, faulty.clock_offset)) if late else 0.0
    for i, row, delay, away, time_error in matches:
        left = np.sign(delay) * np.maximum(np.abs(delay - offset) - np.sqrt(3) * time_error, 0.0)
        at = film.taken[row].copy()
        at[:, i] += np.where(np.isfinite(left), left, 0.0)
        by_time = np.abs(film.places(at) - film.places(film.taken[row]))[:, i]
        moved.append(float(np.max(np.where(np.isfinite(delay), by_time, away) / sigma[row, i], initial=0.0)))
    return Reading(observations=observations, moved=max(moved), share=min(shares), is_exact=is_exact)


def _matched(t: Array, value: Array, taken: Array, points: Array, error: float) -> tuple[Array, Array, Array]:
    """Return for each read point the row of the picture that has its value, how much later it is said to be, and the distance.

    Of several rows with that value, the nearest in time counts. Where none has it, the row is the nearest in time, the delay is
    not a number, and the distance is that of the values [m].
    """
    delay = t[:, None] - taken[None, :]
    away = np.abs(value[:, None] - points[None, :])
    cost = np.abs(delay) + np.where(away <= error, 0.0, 1e9)
    row = np.argmin(cost, axis=1)
    at = np.arange(len(t))
    same = away[at, row] <= error
    return row, np.where(same, delay[at, row], np.nan), away[at, row]


def _identified(path: Path, result: dict[str, Any]) -> dict[str, Any]:
    """Return the verdict on a study in which nothing looks wrong, and a failure if anything is added."""
    verdict, names = _verdict(path)
    if verdict in ("", Verdict.NO_MISSING_EFFECT, Verdict.UNEXPLAINED, Verdict.INTERRUPTED):
        return {"verdict": verdict or names}
    message = f"{verdict}: {names}; {result['outcome']}: {result['message']}"
    return {"outcome": Outcome.ADDED, "verdict": verdict, "message": message}


def _verdict(path: Path) -> tuple[str, str]:
    """Return verdict and names of the credible explanations; an empty one and the reason if the study is refused."""
    try:
        found = identify(study_io.load(path), time_limit=IDENTIFY_LIMIT)
    except HarnessError as error:
        return "", f"refused: {error}"
    return str(found.verdict), " or ".join("+".join(e.names) or "nothing" for e in found.credible)

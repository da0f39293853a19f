"""Draw blind studies: what is hidden, how large it is, the noise, and the number of trials; write their files.

What makes a hidden effect move the light mass by a given size is found by the simulator, which takes longer than to name it.
So the factors are stored; `python -m tests.discrepancy.blind_sample` finds those that are missing (half an hour for all).
"""

import dataclasses
import functools
import itertools
import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.files import write_atomically
from tests.blind.camera import Camera
from tests.blind.cases import CASES, CLEAN_VARIED, UNLISTED, Case, with_signature
from tests.blind.three_masses import HIDDEN, write_three_masses
from tests.discrepancy.blind_study import let_the_tracker_wander, put_on_another_object, write_study
from tests.discrepancy.expected import CANDIDATES, CONVERSIONS, EXPECTED, hidden_number

COUNTS = {"clean": 120, "single": 96, "two": 48, "law": 48, "mixed": 48, "three_masses": 40}
"""Kind -> number of studies, 400 together.

What is hidden is nothing, one listed effect, two, a law that no library lists, or a listed effect beside such a law; of studies
of three light masses it is what `three_masses.HIDDEN` has.
"""
NOISES = (0.5e-3, 1e-3, 2e-3)
"""Standard deviations of a tracked point of a mass at rest, each axis [m]."""
SIZES = (1e-3, 3e-3, 8e-3, 16e-3, 50e-3)
"""How far a single effect moves the light mass [m], RMS over a trial, before any refit."""
SIZES_OF_TWO = SIZES[1:]
"""The same of each of two effects at once, or of an effect and a law."""
THREE_MASSES_NOISE = 2e-3
"""That of the light mass in studies of three light masses [m]."""
TRIALS = {1: ("ten_a",), 2: ("ten_a", "eight"), 3: ("ten_a", "six", "eight"), 4: ("ten_a", "ten_b", "six", "eight")}
"""Number of trials -> their names; "eight" is held out, and of one trial alone blocks of time."""
NOISE_KINDS = ("white", "wander", "outliers")
WANDER = {"amplitude": 0.5e-3, "frames": 10.0}
"""Standard deviation [m] and correlation time [frames] of the error of a tracker that wanders over its mark."""
OUTLIERS = {"share": 0.02, "distance": 0.03}
"""Share of points on another object, and its distance [m]."""


FACTORS = Path(__file__).with_name("blind_factors.json")
"""What `find_factors` found."""


@dataclass(frozen=True, kw_only=True)
class BlindStudy:
    """One blind study: all that its files depend on."""

    hidden: tuple[str, ...]
    """Names of the blind cases that are hidden at once; empty: the study is clean."""
    size: float | None
    """How far each of them moves the light mass [m]; None: the study is clean, or of three light masses."""
    noise: float
    """Standard deviation of a tracked point of a mass at rest, each axis [m]."""
    noise_kind: str = "white"
    """One of `NOISE_KINDS`: what the points have beside white noise."""
    trials: int
    """Number of trials, a key of `TRIALS` but for three light masses."""
    seed: int
    """Seed of the simulator and its camera."""
    kind: str = ""
    """A key of `COUNTS`; empty: the study was not drawn."""
    index: int = 0
    """Number within its kind."""

    @property
    def name(self) -> str:
        """Name of its file in the work folder, without ending."""
        return f"{self.kind}-{self.index:04d}"


def draw(kind: str, count: int, seed: int) -> list[BlindStudy]:
    """Draw ``count`` studies; a smaller count gives the first of them.

    Pairs of effect and size are shuffled as a whole, so that each occurs about as often as any other.
    """
    label = zlib.crc32(kind.encode())
    hidden = _shuffled_hidden(kind, np.random.default_rng([seed, label]))
    studies = []
    for index in range(count):
        rng = np.random.default_rng([seed, label, index])
        names, size = hidden[index % len(hidden)]
        studies.append(
            BlindStudy(
                kind=kind,
                index=index,
                hidden=names,
                size=size,
                noise=THREE_MASSES_NOISE if kind == "three_masses" else float(rng.choice(NOISES)),
                noise_kind=NOISE_KINDS[index % 3] if kind == "clean" else "white",
                trials=3 if kind == "three_masses" else int(rng.choice(list(TRIALS))),
                seed=int(rng.integers(1_000, 2**31)),  # the stored films and the tests have seeds below a thousand
            )
        )
    return studies


def _shuffled_hidden(kind: str, rng: np.random.Generator) -> list[tuple[tuple[str, ...], float | None]]:
    """Return every choice of what is hidden and of its size, in random order."""
    if kind == "clean":
        return [((), None)]
    if kind == "three_masses":
        return [(tuple(numbers), None) for numbers in HIDDEN.values()]
    if kind == "single":
        groups = [(name,) for name in EXPECTED]
    elif kind == "two":
        # a rod that is slippery for one effect alone would change the other
        groups = list(itertools.combinations((n for n in EXPECTED if not CASES[n].apparatus), 2))
    elif kind == "mixed":
        groups = [(n, case.name) for n in EXPECTED if not (CASES[n].apparatus or CASES[n].rigid) for case in UNLISTED]
    else:
        groups = [(case.name,) for case in UNLISTED]
    choices = list(itertools.product(groups, SIZES_OF_TWO if kind in ("two", "mixed") else SIZES))
    return [choices[i] for i in rng.permutation(len(choices))]


@functools.cache
def scaled(name: str, size: float) -> Case:
    """Return a case that moves the light mass by ``size`` [m], by its stored factor.

    Raises
    ------
    ValueError
        If no value of the hidden number does.
    """
    found = stored_factors().get(_key(CASES[name], size))
    if found is None:
        return with_signature(CASES[name], size)
    if not found["factor"]:
        raise ValueError(found["reason"])
    return CASES[name].scaled(found["factor"])


@functools.cache
def stored_factors() -> dict[str, dict[str, Any]]:
    """Return case and size -> the factor of what is hidden, or the reason why there is none."""
    tree: dict[str, dict[str, Any]] = json.loads(FACTORS.read_text(encoding="utf-8")) if FACTORS.exists() else {}
    return tree


def _key(case: Case, size: float) -> str:
    """Return where the factor of a case is stored; another case of the same name has another key."""
    return f"{case.name} {zlib.crc32(repr(case).encode()):08x} {size:g}"


def find_factors(name: str) -> dict[str, dict[str, Any]]:
    """Return the factors of a case for all sizes, each search starting at the size before."""
    found: dict[str, dict[str, Any]] = {}
    start = CASES[name]
    for size in SIZES:
        key = _key(CASES[name], size)
        found[key] = stored_factors().get(key) or _find_factor(start, size)
        if found[key]["factor"]:
            start = CASES[name].scaled(found[key]["factor"])
    return found


def _find_factor(start: Case, size: float) -> dict[str, Any]:
    """Return the factor that gives a case its size, or the reason why there is none; the search begins at ``start``."""
    try:
        case = with_signature(start, size)
    except ValueError as error:
        return {"factor": None, "reason": str(error)}
    return {"factor": hidden_number(case) / hidden_number(CASES[case.name])}


def case_of(study: BlindStudy) -> Case:
    """Return what is hidden in a study as one case, with its noise; friction, drag and angles depend on the seed."""
    cases = [scaled(name, study.size) for name in study.hidden if study.size is not None]
    joined = {
        field: tuple(itertools.chain.from_iterable(getattr(c, field) for c in cases))
        for field in ("effects", "fixed", "apparatus_errors", "camera_errors", "apparatus")
    }
    joined["camera_errors"] += (("noise", study.noise - Camera().noise),)
    return dataclasses.replace(
        CLEAN_VARIED,
        name="_and_".join(study.hidden) or "clean_varied",
        numerics=min((c.numerics for c in cases or [CLEAN_VARIED]), key=lambda n: n.step),
        rigid=any(c.rigid for c in cases),
        **joined,  # type: ignore[arg-type]
    )


def hidden_numbers(study: BlindStudy) -> dict[str, float]:
    """Return blind case -> hidden number."""
    if study.kind == "three_masses":
        return dict(HIDDEN[_kind_of_three_masses(study)])
    return {name: hidden_number(scaled(name, study.size)) for name in study.hidden if study.size is not None}


def _kind_of_three_masses(study: BlindStudy) -> str:
    return next(kind for kind, numbers in HIDDEN.items() if tuple(numbers) == study.hidden)


def planted_values(study: BlindStudy) -> dict[str, float]:
    """Return candidate -> planted value in the candidate's unit; laws, of which there is no candidate, are left out."""
    numbers = hidden_numbers(study).items()
    return {CANDIDATES[name]: CONVERSIONS.get(name, float)(value) for name, value in numbers if name in CANDIDATES}


def write_files(study: BlindStudy, folder: Path) -> Path:
    """Write the files of a study as an experimenter would have them; return the study file."""
    if study.kind == "three_masses":
        return write_three_masses(folder, _kind_of_three_masses(study), study.seed)
    path = write_study(
        folder, case_of(study), study.seed, trials=TRIALS[study.trials], anywhere="wrong_gravity" in study.hidden
    )
    for i, name in enumerate(TRIALS[study.trials]):
        if study.noise_kind == "wander":
            let_the_tracker_wander(folder / f"{name}.csv", seed=study.seed + i, **WANDER)
        elif study.noise_kind == "outliers":
            put_on_another_object(folder / f"{name}.csv", seed=study.seed + i, **OUTLIERS)
    return path


def main() -> None:
    """Find the factors that are missing, and store each case's as soon as they are known."""
    names = [*EXPECTED, *(case.name for case in UNLISTED)]
    known = dict(stored_factors())
    for name in names:
        known |= find_factors(name)
        write_atomically(FACTORS, json.dumps(dict(sorted(known.items())), indent=1) + "\n")
        print(f"{name}: {len(known)} of {len(names) * len(SIZES)} factors are known")


if __name__ == "__main__":
    main()

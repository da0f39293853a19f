"""Show that a change of structure moved no result: `python -m scripts.same_results record|compare FOLDER`.

`record` writes what the program says today as text files, one folder for each of `PARTS`; `compare` says it again and prints
where that differs, with exit status 1. Arrays are written as the hash of their bytes, beside a few of their numbers, so that a
difference can be read. Some minutes on two cores; ``--only PART`` for one of them.
"""

import contextlib
import difflib
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

Texts = dict[str, str]
"""File name -> its text."""
SAMPLES = 400
"""Times at which the runs of a scenario are sampled."""
INPUTS = 300
"""Damaged inputs of each kind."""
SHOWN_LINES = 40
"""Lines of a difference that are printed."""
COMPARED = ("ten_to_one", "two_to_one", "held", "drop")
"""Scenarios on which every variant of every engine runs."""


def runs() -> Texts:
    """Return runs of the reference: each shipped scenario alone, many of it in a batch, and their derivatives."""
    from looping_pendulum.reference_ode.batch import solve_batch
    from looping_pendulum.reference_ode.sensitivity import solve_sensitivities
    from looping_pendulum.reference_ode.solve import solve_at
    from looping_pendulum.scenarios import loader

    texts = {}
    for name in loader.shipped():
        scenario = loader.load(name)
        p, t = scenario.parameters, np.linspace(0.0, scenario.duration, SAMPLES)
        angles = p.release_angle + np.linspace(-0.05, 0.05, 64)
        results = {
            "alone": solve_at(p, t),
            "batch": solve_batch(p, {"release_angle": angles}, duration=scenario.duration),
            "derivatives": solve_sensitivities(p, t, ["release_angle", "light_mass"]),
        }
        texts[f"{name}.txt"] = "\n".join(f"{what} {_said(result)}" for what, result in results.items())
    return texts


def words() -> Texts:
    """Return the help of every command, the schemas, and pages that are made from tables."""
    from looping_pendulum.live.generate import model_source
    from scripts.written_pages import pages

    texts = {"model.js": model_source()} | {f"{name}.md": text for name, text in pages().items()}
    listed = _command("--help")
    from looping_pendulum.cli.main import GROUPS

    commands = [name for group in GROUPS.values() for name in group]
    texts |= {"help.txt": listed} | {f"help-{name}.txt": _command(name, "--help") for name in commands}
    return texts | {f"schema-{name}.json": _command(name, "--schema") for name in ("scenarios", "identify", "map")}


def imports() -> Texts:
    """Return the modules that ``--help`` imports."""
    code = "import sys, looping_pendulum.cli.main; print(*sorted(m for m in sys.modules if m.startswith('looping')), sep='\\n')"
    return {"modules.txt": subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout}


def comparisons() -> Texts:
    """Return what `compare` says of every variant that is installed, with quick settings, but for its clock.

    The keys of kept runs are left out, too, as they hash the engines' sources; the report is written again without either.
    """
    from looping_pendulum.compare.report import comparison_markdown
    from looping_pendulum.compare.result import ComparisonResult

    texts = {}
    for name in COMPARED:
        with tempfile.TemporaryDirectory() as folder:
            _command("compare", name, "--out", folder, "--quiet", allowed=(0, 1))
            result = json.loads(Path(folder, "result.json").read_text(encoding="utf-8"))
            del result["run_keys"]
            result["clock"]["written"] = ""
            for times in result["clock"]["wall_times"]:
                times |= {key: 0.0 for key, value in times.items() if isinstance(value, float)}
            texts[f"{name}.json"] = json.dumps(result, indent=1)
            texts[f"{name}.md"] = comparison_markdown(ComparisonResult.from_json(texts[f"{name}.json"]))
            texts |= _written(Path(folder), name, skip=("result.json", "report.md", "report.html"))
    return texts


def studies() -> Texts:
    """Return what `identify` says of stored blind studies and of the example, with its report and figures."""
    from looping_pendulum.teaching.example_folder import write_example
    from tests.blind.cases import CASES
    from tests.discrepancy.blind_study import TWO_RATIOS, write_study

    cases = {"clean": 5, "linear_drag": 1, "magnet": 1, "scale": 1}
    texts = {}
    with tempfile.TemporaryDirectory() as folder:
        write_example(Path(folder, "example"))
        paths = {"example": Path(folder, "example", "study.yaml")}
        for name, seed in cases.items():
            Path(folder, name).mkdir()
            paths[name] = write_study(Path(folder, name), CASES[name], seed, trials=TWO_RATIOS)
        for name, path in paths.items():
            out = Path(folder, f"report-{name}")
            _command("identify", str(path), "--out", str(out), "--quiet", cwd=path.parent)
            texts |= _written(out, name)
    return texts


def messages() -> Texts:
    """Return what is said of damaged inputs."""
    from tests.fuzz.kinds import KINDS

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        return {f"{name}.txt": "\n".join(_said_of_damaged(kind)).replace(folder, ".") for name, kind in KINDS.items()}


def _said_of_damaged(kind: Any) -> list[str]:
    """Return what is said of inputs of one kind, the same ones every time."""
    from hypothesis import HealthCheck, Phase, given, settings

    from looping_pendulum.errors import HarnessError

    lines = []

    @settings(
        max_examples=INPUTS,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(kind.inputs(kind.seeds()))
    def note(data: bytes) -> None:
        try:
            kind.run(data)
        except HarnessError as error:
            lines.append(str(error))
        else:
            lines.append("accepted")

    note()
    return lines


PARTS: Mapping[str, Callable[[], Texts]] = {
    part.__name__: part for part in (comparisons, studies, messages, runs, words, imports)
}
"""Those that take longest come first."""


def _said(value: Any) -> str:
    """Return the hash of all numbers of a result, and a few of them."""
    arrays: list[np.ndarray] = []

    def collect(one: Any) -> None:
        if isinstance(one, np.ndarray | float | int):
            arrays.append(np.asarray(one))
        elif isinstance(one, Mapping):
            for key in sorted(one, key=str):
                collect(one[key])
        elif isinstance(one, list | tuple):
            for item in one:
                collect(item)
        elif hasattr(one, "__dataclass_fields__"):
            for name in sorted(one.__dataclass_fields__):
                collect(getattr(one, name))

    collect(value)
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()[:16]
    numbers = np.concatenate([np.ravel(a).astype(float) for a in arrays if a.dtype.kind in "fiub"])
    some = numbers[np.linspace(0, len(numbers) - 1, 12).astype(int)]
    return f"{len(numbers)} numbers, {digest}: {' '.join(f'{v:.12g}' for v in some)}"


def _written(folder: Path, name: str, skip: tuple[str, ...] = ()) -> Texts:
    """Return the files of a report: text as it is, pictures and pages as their hash."""
    texts = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.name not in skip):
        is_text = path.suffix in (".md", ".json", ".yaml", ".csv")
        text = path.read_text(encoding="utf-8") if is_text else hashlib.sha256(path.read_bytes()).hexdigest()
        texts[f"{name}--{path.relative_to(folder).as_posix().replace('/', '--')}{'' if is_text else '.hash'}"] = text
    return texts


def _command(*arguments: str, allowed: tuple[int, ...] = (0,), cwd: Path | None = None) -> str:
    environment = os.environ | {"COLUMNS": "120", "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-m", "looping_pendulum", *arguments], capture_output=True, text=True, env=environment, cwd=cwd
    )
    if done.returncode not in allowed:
        raise RuntimeError(f"{' '.join(arguments)}: {done.stderr}")
    return done.stdout


def _part(name: str) -> Texts:
    return PARTS[name]()


def main(
    action: Annotated[str, typer.Argument(metavar="record|compare")],
    folder: Path,
    only: Annotated[list[str] | None, typer.Option(metavar="PART", help=f"Repeatable; of: {', '.join(PARTS)}.")] = None,
) -> None:
    """Record what the program says, or compare it with what was recorded."""
    if action not in ("record", "compare"):
        raise typer.BadParameter(f"found {action!r}, needed record or compare")
    differing = 0
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        names = only or list(PARTS)
        for name, texts in zip(names, pool.map(_part, names), strict=True):
            here = folder / name
            if action == "record":
                here.mkdir(parents=True, exist_ok=True)
                for file, text in texts.items():
                    (here / file).write_text(text, encoding="utf-8")
                print(f"{name}: {len(texts)} files")
                continue
            before = {p.name: p.read_text(encoding="utf-8") for p in here.iterdir()} if here.exists() else {}
            different = [file for file in sorted({*before, *texts}) if before.get(file) != texts.get(file)]
            differing += len(different)
            print(f"{name}: {len(different)} of {len(texts)} files differ")
            for file in different:
                pair = (before.get(file, "").splitlines(), texts.get(file, "").splitlines())
                lines = list(difflib.unified_diff(*pair, f"recorded/{file}", f"now/{file}", lineterm="", n=0))
                print("\n".join(line[:240] for line in lines[:SHOWN_LINES]))
    raise typer.Exit(bool(differing))


if __name__ == "__main__":
    typer.run(main)

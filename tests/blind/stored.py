"""Stored output of the simulator for the daily tests: its motions take a minute of processor time, their points 30 kB a case.

Each file carries a digest of the sources that made it. If they have changed since, or the file is missing, the simulator runs:
an old file costs time, but never gives a wrong result. ``python -m tests.blind.stored`` writes the files again.
"""

import hashlib
import zipfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

HERE = Path(__file__).parent
DATA = HERE / "data"
SOURCES = (*sorted(HERE.glob("*.py")), HERE.parent / "discrepancy/event_study.py")
DIGEST = "made_by.sha256"
ZIP_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of every file in an archive: a constant, so that an archive's bytes depend on its contents alone."""


@cache
def digest() -> str:
    """Return the digest of all sources that the stored numbers depend on: tests and this file are left out."""
    sources = [path for path in SOURCES if path != Path(__file__) and not path.name.startswith("test_")]
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in sources)).hexdigest()


def archive_name(kind: str, case: str, seed: int, trials: Iterable[str] = ()) -> str:
    """Return the name of the archive of a case; its ``kind`` is "tracks", "tables" or "three_masses"."""
    return "-".join([kind, case, str(seed), *trials])


def stored_or_written(name: str, folder: Path, write: Callable[[Path], None]) -> None:
    """Fill ``folder`` from the archive ``name``, or by ``write`` if the archive is missing or of other sources."""
    folder.mkdir(parents=True, exist_ok=True)
    archive = DATA / f"{name}.zip"
    if archive.exists():
        with zipfile.ZipFile(archive) as files:
            if files.read(DIGEST).decode() == digest():
                files.extractall(folder, [file for file in files.namelist() if file != DIGEST])
                return
    write(folder)


def store(name: str, folder: Path) -> None:
    """Store all files of ``folder`` as the archive ``name``."""
    DATA.mkdir(exist_ok=True)
    contents = {DIGEST: digest().encode()} | {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    with zipfile.ZipFile(DATA / f"{name}.zip", "w", zipfile.ZIP_DEFLATED) as files:
        for file, content in contents.items():
            files.writestr(zipfile.ZipInfo(file, ZIP_DATE), content, zipfile.ZIP_DEFLATED)


def main() -> None:
    """Write all archives that the daily tests read."""
    import tempfile

    from tests.blind.cases import CASES, simulate_case
    from tests.blind.three_masses import simulate_three_masses
    from tests.discrepancy.event_study import simulate_tables

    for name, seed in TRACKS:
        with tempfile.TemporaryDirectory() as folder:
            simulate_case(Path(folder), CASES[name], seed)
            store(archive_name("tracks", name, seed), Path(folder))
    for name, seed, trials in TABLES:
        with tempfile.TemporaryDirectory() as folder:
            simulate_tables(Path(folder), CASES[name], seed, trials)
            store(archive_name("tables", name, seed, trials), Path(folder))
    for name, seed in THREE_MASSES:
        with tempfile.TemporaryDirectory() as folder:
            simulate_three_masses(Path(folder), name, seed)
            store(archive_name("three_masses", name, seed), Path(folder))


TRACKS = (
    *(("clean", seed) for seed in (0, 1, 2, 3, 5)),
    ("clean_varied", 5),
    ("linear_drag", 1),
    ("frame_rate", 0),
    ("scale", 1),
    ("thrust", 3),
    ("rough_patch", 1),
    ("magnet", 3),
    ("static_excess", 0),
    ("side_force", 0),
    ("pixel_aspect", 0),
)
"""Case and seed of every simulated film that a daily test reads."""
TABLES = (
    ("clean", 1, ("ten_a", "six", "eight")),
    ("side_force", 0, ("ten_a", "ten_b", "six", "eight")),
    ("clean", 3, ("ten_a", "eight")),
)
"""Case, seed and trials of every table of events that a daily test reads."""
THREE_MASSES = tuple(
    (kind, seed)
    for kind in ("friction_per_turn", "friction_speed", "magnet", "rough_patch", "side_pull_and_patch")
    for seed in (100, 101)
)
"""Kind and seed of every study of three light masses that a test reads."""

if __name__ == "__main__":
    main()

"""Run many releases of one engine, and name each release in which a number moved by more than its spread.

`python -m research.releases mujoco --from 3.1 --to 3.3 --work DIR` installs each release with NumPy and SciPy into an
environment of its own, by pip or uv, and removes it afterwards; nothing is compiled. Each runs the scenario and the static
capstan test. The spread is the standard deviation of a number when the start changes by 0.01 deg or 0.1 mm, with the newest
release that runs. A release that cannot be installed or run is a row with its error. Ended releases are kept in DIR: after
Ctrl-C, the same command continues from there. What was found takes the place of the engine's earlier study in
research/data/versions.json, from which docs/img/versions.png is drawn again.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path

from looping_pendulum.cli.terminal import ProgressBars, show_table
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.files import prepare_output_folder, write_atomically
from looping_pendulum.scenarios import load
from research import DATA, IMAGES, rounded
from research.releases.figure import png_of
from research.releases.installers import list_releases
from research.releases.result import HEADER, ReleasesResult, move_sentences, rows
from research.releases.study import ReleaseStudy, chosen_releases, chosen_variants, distribution_of

STORED = DATA / "versions.json"


def read_stored() -> list[ReleasesResult]:
    """Return the stored studies."""
    trees = json.loads(STORED.read_text(encoding="utf-8"))["studies"]
    return [ReleasesResult.from_json(json.dumps(tree)) for tree in trees]


def store(results: Iterable[ReleasesResult]) -> None:
    """Store studies, with one line for each release to keep the file small."""
    trees = [rounded(json.loads(result.to_json()), digits=6) for result in results]  # more than the page prints
    text = json.dumps({"studies": trees}, separators=(",", ":")).replace('{"error":"","packages"', '\n{"error":"","packages"')
    write_atomically(STORED, text + "\n")


def main() -> None:
    """Run the releases that were asked for, print what moved, and store it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("engine", help="such as mujoco")
    parser.add_argument("--from", dest="first", help="oldest release; by default the first there is")
    parser.add_argument("--to", dest="last", help="newest release; by default the last there is")
    parser.add_argument("--versions", help="only these releases, joined by commas")
    parser.add_argument("--variant", action="append", default=[], help="by default the main ones; repeatable")
    parser.add_argument("--work", type=Path, required=True, help="folder in which ended releases are kept")
    parser.add_argument("--time-limit", type=float, default=900.0, help="of a run [s]")
    parser.add_argument("--memory-limit", type=int, default=2 << 30, help="of a run [bytes]")
    parser.add_argument("--jobs", type=int, default=2, help="releases at the same time")
    options = parser.parse_args()
    engines = chosen_variants(options.engine, options.variant, Profile.QUICK)
    package = distribution_of(engines[0])
    releases = chosen_releases(package, list_releases(package), first=options.first, last=options.last, listed=options.versions)
    prepare_output_folder(options.work, folders=("releases", "environments"))
    with ProgressBars(time_left=True) as bars:
        study = ReleaseStudy(
            engines,
            load("ten_to_one"),
            options.work,
            jobs=options.jobs,
            time_limit=options.time_limit,
            memory_limit=options.memory_limit,
            progress=bars.update,
        )
        result = study.run(releases)
    show_table(HEADER, rows(result))
    if result.interrupted:
        sys.exit(f"interrupted: {len(result.releases)} of {len(releases)} releases are kept in {options.work}")
    for release, label, sentence in move_sentences(result):
        print(f"- {release}, {label}, {sentence}")
    studies = [*(other for other in read_stored() if other.engine != result.engine), result]
    store(studies)
    write_atomically(IMAGES / "versions.png", png_of(studies))


if __name__ == "__main__":
    main()

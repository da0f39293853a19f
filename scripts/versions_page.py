"""Write docs/versions.md and its figure: what moved from release to release of each engine.

`python -m scripts.versions_page report/versions-mujoco/versions.json ...` first stores results of `looping-pendulum versions`
in docs/data/versions.json, each in place of the engine's earlier one; without files it writes the page from what is stored.
"""

import argparse
import json
import math
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path

import yaml

from benchmarks import rounded
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import number
from looping_pendulum.releases.figure import png_of
from looping_pendulum.releases.result import QUANTITIES, SHOWN, ReleaseRow, ReleasesResult, move_sentences, remark
from scripts.written_pages import TITLES

DOCS = Path(__file__).parents[1] / "docs"
STORED, CAUSES = DOCS / "data" / "versions.json", DOCS / "data" / "version_causes.yaml"
PAGE, FIGURE = DOCS / "versions.md", DOCS / "img" / "versions.png"


def read_stored(path: Path = STORED) -> list[ReleasesResult]:
    """Return the stored studies, in the order of `TITLES`."""
    trees = json.loads(path.read_text(encoding="utf-8"))["studies"] if path.exists() else []
    results = [ReleasesResult.from_json(json.dumps(tree)) for tree in trees]
    return sorted(results, key=lambda result: list(TITLES).index(result.engine))


def store(results: Iterable[ReleasesResult], path: Path = STORED) -> None:
    """Store studies, with one line for each release to keep the file small."""
    trees = [rounded(json.loads(result.to_json()), digits=6) for result in results]  # more than the page prints
    text = json.dumps({"studies": trees}, separators=(",", ":")).replace('{"error":"","packages"', '\n{"error":"","packages"')
    write_atomically(path, text + "\n")


def read_causes(path: Path = CAUSES) -> dict[tuple[str, str], str]:
    """Return (engine, release) -> why its numbers moved, with the source."""
    entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    return {(e["engine"], str(e["release"])): f"{' '.join(e['why'].split())} ({e['source']})" for e in entries}


def page(results: Sequence[ReleasesResult], causes: dict[tuple[str, str], str]) -> str:
    """Return the text of the page."""
    sections = "\n".join(_section(result, causes) for result in results)
    counts = ", ".join(f"{sum(r.ran for r in result.releases)} of {TITLES[result.engine]}" for result in results)
    return f"""# What changes from version to version

`python -m scripts.versions_page` writes this page from `docs/data/versions.json`, which holds results of `looping-pendulum
versions`, and from `docs/data/version_causes.yaml`; do not edit it by hand. The [glossary](glossary.md) explains the terms.

Older and newer releases ran the 10:1 trial and the static capstan test with the adapters and settings of today, quick profile:
{counts}.
A user who upgrades an engine sees here whether a rope over a rod behaves differently afterwards.

```sh
looping-pendulum versions mujoco --from 3.1 --to 3.3            # every release between the two
looping-pendulum versions pymunk --versions 6.11.1,7.0.0        # only these
```

The command installs each release with NumPy and SciPy into an environment of its own, which is removed afterwards; where one
does not run with today's NumPy, it tries `numpy<2` and says so. The reference is solved once, outside. A number **moved** if it
differs from that of the last release that ran by more than its *spread*, its standard deviation when the start changes by
0.01 deg or 0.1 mm (measured once, with the newest release that runs), and by more than a millionth of its SI unit. A dash
stands where there is no value, as for the halting time of a run that never halts. A chain of beads is chaotic: other rounding
acts on it like another start, so that a move of up to three spreads need not mean another behaviour. Processor times are given
as multiples of the newest release's, were taken beside other work, and are not judged; what a variant costs is on the
page of accuracy.

![Errors of each variant against the release](img/versions.png)

{sections}"""


def _section(result: ReleasesResult, causes: dict[tuple[str, str], str]) -> str:
    """Return the section of one engine."""
    engine, names = result.engine, {row.release for row in result.releases}
    first, last = result.releases[0].release, result.releases[-1].release
    opening = f"{len(result.releases)} releases, {first} to {last}, with Python {result.python}, on {result.date}."
    texts = [f"## {TITLES[engine]}\n\n{opening}\n\n### What moved\n"]
    rows = move_sentences(result)
    texts.append(table(["release", "variant", "what moved"], rows, left=3) if rows else "Nothing.\n")
    reasons = [f"- **{release}**: {why}" for (name, release), why in causes.items() if name == engine and release in names]
    unknown = dict.fromkeys(release for release, *_ in rows if (engine, release) not in causes)
    if unknown:
        reasons.append(f"- {', '.join(unknown)}: nobody has looked for the reason yet.")
    if reasons:
        texts.append("\n".join(["Why:\n", *reasons]) + "\n")
    texts.append("### The numbers\n\nReleases with the same numbers share a row.\n")
    texts.append(_numbers(result))
    return "\n".join(texts)


def _numbers(result: ReleasesResult) -> str:
    """Return the table of one engine's numbers; neighbours that print the same share a row."""
    head = ["variant", "releases", *(QUANTITIES[name].column for name in SHOWN), "CPU, of the newest", "remark"]
    rows = []
    for label in result.labels():
        lines = [(row, _cells(row, label)) for row in result.releases if not row.error]
        newest = next((time for row, _ in reversed(lines) for time in _cpu_times([row], label)), math.nan)
        for cells, group in groupby(lines, key=lambda line: line[1]):
            same = [row for row, _ in group]
            rows.append([label, _names(same), *cells[:-1], _cpu(same, label, newest), cells[-1]])
    for _, group in groupby((row for row in result.releases if row.error), key=lambda row: row.error.replace(row.release, "")):
        same = list(group)
        rows.append(["all", _names(same), *[""] * len(SHOWN), "", f"not installed: {same[0].error}"])
    spread = result.spread
    if spread is not None:
        for label in result.labels():
            of_label = spread.values.get(label, {})
            sizes = [QUANTITIES[name].quantity(of_label.get(name)).partition(" ")[0] for name in SHOWN]
            rows.append([label, f"spread, with {spread.release}", *sizes, "", ""])
    return table(head, rows, left=2)


def _cells(row: ReleaseRow, label: str) -> tuple[str, ...]:
    variant = next(v for v in row.variants if v.label == label)
    values = (QUANTITIES[name].cell(variant.values.get(name)) if variant.ran else "" for name in SHOWN)
    return (*values, remark(row, variant))


def _names(rows: Sequence[ReleaseRow]) -> str:
    first, last = rows[0].release, rows[-1].release
    return first if len(rows) == 1 else f"{first} to {last} ({len(rows)})"


def _cpu_times(rows: Sequence[ReleaseRow], label: str) -> list[float]:
    """Return a variant's processor times [s], of the releases that ran."""
    return [time for row in rows if (v := row.variant(label)) is not None and (time := v.cpu_time) is not None]


def _cpu(rows: Sequence[ReleaseRow], label: str, newest: float) -> str:
    """Return the range of a variant's processor times as multiples of the ``newest`` release's [s]."""
    times = _cpu_times(rows, label)
    if not times:
        return ""
    low, high = number(min(times) / newest, digits=2), number(max(times) / newest, digits=2)
    return low if low == high else f"{low} to {high}"


def main() -> None:
    """Store the results that are given, and write page and figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="results of `looping-pendulum versions`")
    given = [ReleasesResult.from_json(path.read_text(encoding="utf-8")) for path in parser.parse_args().files]
    if given:
        replaced = {result.engine for result in given}
        store([*(result for result in read_stored() if result.engine not in replaced), *given])
    results = read_stored()
    write_atomically(FIGURE, png_of(results))
    write_atomically(PAGE, page(results, read_causes()))
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()

"""Write docs/leaderboard.md, one row per variant, from the stored engine study and the stored static capstan test.

`python -m benchmarks.leaderboard --static NAME`, which may be repeated, first makes the static capstan test of that engine or
variant: half a turn with its own settings, kept in docs/data/static_capstan.json.
"""

import argparse
import datetime
import html
import json
import math
from dataclasses import dataclass
from typing import Any

from benchmarks.stored_study import DOCS, SUMMARY, EngineStudy, Measurement, own_costs, read
from looping_pendulum.compare.convergence.result import VariantStudy
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import DISTRIBUTIONS, label, missing_packages, select
from looping_pendulum.engines.tension import measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.numbers import GAP, number, signed
from looping_pendulum.versions import installed_version

PAGE, STORED = DOCS / "leaderboard.md", DOCS / "data" / "static_capstan.json"
COMMAND = "python -m benchmarks.leaderboard"
NUMBERS = ("static ratio", "halting time [ms]", "path [mm]", "cost")
NUMBER_STYLE = ' style="text-align: right"'
FRICTION, WRAP_ANGLE = 0.34, math.pi
"""Friction coefficient and wrap angle at release [rad] of the static test."""
HEAD = ("variant", *NUMBERS, "law by", "versions", "measured")


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell of the table."""

    text: str
    order: float | str | None
    """What the column is sorted by; None: last, in both directions."""

    def html(self) -> str:
        """Return the cell as HTML."""
        order = "" if self.order is None else self.order if isinstance(self.order, str) else f"{self.order:.6g}"
        kind = "" if isinstance(self.order, str) else NUMBER_STYLE
        return f'<td{kind} data-value="{html.escape(order)}">{html.escape(self.text)}</td>'


def page(study: EngineStudy, static_rows: list[dict[str, Any]]) -> str:
    """Return the page of Markdown with the table in HTML, whose cells know what they are sorted by."""
    static = {row["variant"]: row for row in static_rows}
    costs = own_costs(study)
    measured = {m.variant: m for m in study.measurements}
    variants = sorted(study.convergence.variants, key=lambda v: (_path(v) is None, _path(v) or 0.0))
    rows = [cells(v, static[v.label], costs.get(v.label), measured[v.label]) for v in variants]
    body = "\n".join(f"<tr>{''.join(cell.html() for cell in row)}</tr>" for row in rows)
    head = "".join(f'<th scope="col"{NUMBER_STYLE if name in NUMBERS else ""}>{name}</th>' for name in HEAD)
    mu = f"{static_rows[0]['friction']:g}"
    return f"""# Leaderboard of all variants

Every variant at its own settings of the quick profile, sorted by the error of the path. Click the head of a column to sort by
it. The [engine study](engine-study.md) says where the errors come from and what to choose.

<div class="leaderboard">
<table>
<thead><tr>{head}</tr></thead>
<tbody>
{body}
</tbody>
</table>
</div>

- **static ratio**: tension ratio of a string that just slides over half a turn, over exp(mu theta), with mu = {mu}; 1 is exact.
- **halting time**, **path**: error in `{study.convergence.scenario}`, halting time less the reference's, and the root mean
  square distance of the light mass from the reference's to 0.7 s.
- **cost**: CPU seconds per simulated second.
- **law by**: who supplies the friction of the string on the rod. If the adapter does, the static ratio is the adapter's own,
  and so it is where the adapter gives the engine's constant friction its size (`mujoco:frictionloss`).
- **measured**: first and last day on which a number of the row was measured.
- **{GAP}**: the run broke off, or that number was not measured.

`{COMMAND}` writes this page from `docs/data/engine_study.json` and `docs/data/static_capstan.json`; do not edit it by
hand. To add or renew a row: `python -m benchmarks.engine_study --engine NAME --work DIR`, then
`{COMMAND} --static NAME`.
"""


def cells(v: VariantStudy, static: dict[str, Any], cost: float | None, measured: Measurement) -> list[Cell]:
    """Return the cells of one variant's row."""
    days = sorted({day for day in (measured.errors, measured.times, static["day"]) if day})
    versions = ", ".join(f"{k} {x}" for k, x in v.provenance.versions.items())
    law = next((s.by for s in v.provenance.supplies if s.what == "friction law"), GAP)
    path, halt = _path(v), v.own.halting_time_error
    never = v.own.ok and v.own.halting_time is None
    return [
        Cell(text=v.label, order=v.label),
        _static_cell(static),
        Cell(text="never" if never else signed(halt, 1e3, 2), order=None if halt is None else abs(halt)),
        Cell(text=number(path, 1e3, 2), order=path),
        Cell(text=number(cost, digits=2), order=cost),
        Cell(text=law, order=law),
        Cell(text=versions or GAP, order=versions),
        Cell(text=" to ".join(dict.fromkeys((days[0], days[-1]))), order=days[-1]),
    ]


def _path(v: VariantStudy) -> float | None:
    return v.own.rms["path_0.7s"] if v.own.ok else None


def _static_cell(row: dict[str, Any]) -> Cell:
    """Return the ratio of the measured tension ratio to the capstan law's; a column of these is sorted by distance from 1."""
    if row["exponent"] is None:
        return Cell(text=GAP, order=None)
    error = row["exponent"] - row["friction"] * row["wrap_angle"]
    return Cell(text=f"{math.exp(error):.4f}", order=abs(error))


def stored() -> list[dict[str, Any]]:
    """Return the stored measurements, one per variant."""
    rows: list[dict[str, Any]] = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else []
    return rows


def measure(names: list[str]) -> None:
    """Measure variants and add them to the stored measurements, each as soon as it is done; those that are there stay."""
    for engine in select(names, Profile.QUICK):
        if missing_packages(engine):
            continue
        rows = {row["variant"]: row for row in stored()} | {label(engine): _static_row(engine)}
        lines = ",\n".join(json.dumps(row) for row in sorted(rows.values(), key=lambda row: row["variant"]))
        write_atomically(STORED, f"[\n{lines}\n]\n")
        print(rows[label(engine)], flush=True)


def _static_row(engine: Engine) -> dict[str, Any]:
    """Return the measurement of a variant: exponents, or the reason why it has none, with the day and the versions."""
    packages = [DISTRIBUTIONS.get(package, package) for package in engine.abilities.packages]
    row: dict[str, Any] = {
        "variant": label(engine),
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "versions": {package: installed_version(package) for package in packages},
        "friction": FRICTION,
    }
    try:
        point = measure_capstan_exponent(engine, friction=FRICTION, wrap_angle=WRAP_ANGLE)
    except EngineError as error:
        return row | {"wrap_angle": None, "exponent": None, "why": str(error)}
    return row | {"wrap_angle": point.wrap_angle, "exponent": point.exponent, "why": ""}


def main() -> None:
    """Make the tests that were asked for, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--static", action="append", default=[], metavar="NAME", help="make its static capstan test first")
    if names := parser.parse_args().static:
        measure(names)
    write_atomically(PAGE, page(read(SUMMARY.read_text(encoding="utf-8")), stored()))
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()

"""Write README's table of engines from the results of `compare ten_to_one`.

`python -m scripts.engine_table quick/result.json accurate/result.json` stores the values that the table needs in
`docs/data/ten_to_one`; `python -m scripts.docs_numbers` writes the table from there. A variant's cost with the quick profile is
that of the leaderboard, where it has one: the median of some runs, one at a time. Make the results with `--jobs 1` on an
otherwise idle machine: CPU times, too, grow by a third where a neighbour uses the other half of a core.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

from benchmarks import rounded
from benchmarks.stored_study import SUMMARY, own_costs, read
from looping_pendulum.pages.numbers import GAP, amount, quantity
from looping_pendulum.scenarios.metrics import RMS_END_TIMES

FOLDER = Path(__file__).parents[1] / "docs" / "data" / "ten_to_one"
BEGIN, END = "<!-- table of engines: python -m scripts.docs_numbers -->", "<!-- end of the table -->"
BLOCK = re.compile(rf"{re.escape(BEGIN)}\n.*?{re.escape(END)}", re.DOTALL)
ROWS = {
    "mujoco:documented": ("MuJoCo, tendon as documented", ("quick",)),
    "mujoco:capstan": ("MuJoCo, capstan bound by the adapter", ("quick", "accurate")),
    "mujoco:beads": ("MuJoCo, beads over a cylinder", ("quick", "accurate")),
    "pymunk:chain": ("pymunk, beads over a circle", ("quick", "accurate")),
    "pybullet:chain": ("PyBullet, link chain over a sphere", ("quick", "accurate")),
    "drake:chain": ("Drake, beads over a sphere", ("quick",)),
    "box2d:chain": ("Box2D, beads over a circle", ("quick",)),
    "rapier:chain": ("Rapier, beads over a cylinder", ("quick",)),
    "exudyn:cable": ("Exudyn, elastic cable over a circle", ("quick",)),
    "newton:tendon": ("Newton, its own capstan tendon", ("quick",)),
}
"""Variant -> its name in the table, and the profiles for which the table has a row."""
MICROMETRE_LIMIT = 1e-6
"""Distance below which a row is given in micrometres [m]."""
PROFILES = ("quick", "accurate")


def store_results(results: list[Path]) -> None:
    """Store the values of each result that the table needs, with their origin."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for file in results:
        tree = json.loads(file.read_text(encoding="utf-8"))
        profiles = {e["profile"] for e in tree["engines"]}
        if tree["scenario"] != "ten_to_one" or len(profiles) != 1:
            raise SystemExit(f"{file}: found {tree['scenario']}, {sorted(profiles)}; needed ten_to_one in one profile")
        (profile,) = profiles
        costs = {(w["engine"], w["profile"]): w["cpu_per_simulated_second"] for w in tree["clock"]["wall_times"]}
        stored_result = {
            "command": f"looping-pendulum compare ten_to_one --profile {profile} --jobs 1",
            "measured_on": tree["clock"]["written"][:10],
            "engines": {
                (name := f"{e['engine']}:{e['variant']}"): {
                    "status": e["status"],
                    "versions": e["provenance"]["versions"],
                    "metrics": rounded(e["metrics"], digits=6),
                    "cpu_per_simulated_second": rounded(costs[name, profile], digits=6),
                }
                for e in tree["engines"]
            },
        }
        (FOLDER / f"{profile}.json").write_text(json.dumps(stored_result, indent=1) + "\n", encoding="utf-8")


def table() -> str:
    """Return the table in Markdown."""
    costs = own_costs(read(SUMMARY.read_text(encoding="utf-8")))
    stored = {p: json.loads((FOLDER / f"{p}.json").read_text(encoding="utf-8"))["engines"] for p in PROFILES}
    lines = [
        "| engine and variant | profile | RMS of the light mass to 0.35 / 0.7 / 1.0 s | halting-time error "
        "| rebound | CPU s per simulated s |",
        "|---|---|---|---|---|---|",
    ]
    for variant, (title, profiles) in ROWS.items():
        for profile in profiles:
            engine = stored[profile][variant]
            cost = costs.get(variant) if profile == "quick" else None
            lines.append(
                _row(title if profile == profiles[0] else "", profile, engine, cost or engine["cpu_per_simulated_second"])
            )
    return "\n".join(lines)


def _row(title: str, profile: str, engine: dict[str, Any], cost: float | None) -> str:
    m = engine["metrics"]
    scale, unit = (1e3, "mm") if max(m.get(metric) or 0.0 for metric in RMS_END_TIMES) >= MICROMETRE_LIMIT else (1e6, "µm")
    path = " / ".join(amount(m[metric], scale) for metric in RMS_END_TIMES) + f" {unit}"
    error = m["halting_time_error"]
    halt = "never halts" if error is None else quantity(abs(error), "s")
    if engine["status"] != "FINISHED":
        path, halt = GAP, f"its run ends at {quantity(m['simulated_time'], 's')}"
    then = quantity(m.get("rebound"), "m")
    cells = [title, profile, path, halt, then, amount(cost)]
    return f"| {' | '.join(cells)} |".replace("|  |", "| |")


def with_current_table(text: str) -> str:
    """Return a page with the table between its markers replaced by that of the stored results."""
    if not BLOCK.search(text):
        raise ValueError(f"needed the markers {BEGIN!r} and {END!r}")
    return BLOCK.sub(lambda _: f"{BEGIN}\n{table()}\n{END}", text)


def without_table(text: str) -> str:
    """Return a page without the table."""
    return BLOCK.sub("", text)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    store_results([Path(name) for name in sys.argv[1:]])

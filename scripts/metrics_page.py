"""Write docs/metrics.md, the page of the metrics and of a map's variables, from their tables.

python -m scripts.metrics_page
"""

from pathlib import Path

from looping_pendulum.pages.markdown import table
from looping_pendulum.scenarios.metrics import METRICS
from looping_pendulum.sweep.cells import FIELDS

PAGE = Path(__file__).parents[1] / "docs" / "metrics.md"


def page() -> str:
    """Return the text of the page."""
    head = ["metric", "SI unit", "shown in", "limit", "meaning"]
    variables = [[f"`{f.name}`", f.unit, f.meaning] for f in FIELDS]
    rows = [[f"`{m.name}`", m.unit, m.shown_in.name, m.limit_words, m.description] for m in METRICS.values()]
    return f"""# Metrics

`python -m scripts.metrics_page` writes this page from `scenarios/metrics.py` and `reference_ode/batch/runs.py`; do not edit it.
The [glossary](glossary.md) explains the terms.

These numbers say how far an engine's run is from the reference. `result.json` holds them in SI units, and `null` where a metric
is not defined: an end time or a halt that the run or the reference does not reach, or a release of another kind. Differences
are positive for what is late or more than the reference. A scenario's tolerances may limit each of them: a limit of the kind
*at most* holds for the magnitude.

{table(head, rows, left=len(head))}
## Variables of a map

What a [map](maps.md) holds of every run; its report gives the smallest, mean and largest value of each that is no code.

{table(["variable", "SI unit", "meaning"], variables, left=3)}"""


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

"""Write docs/repro.md, the page of the claims about engines, from the heads of the scripts in `looping_pendulum/repro/scripts`.

python -m scripts.repro_page
"""

from itertools import groupby
from pathlib import Path

from looping_pendulum.pages.markdown import table
from looping_pendulum.repro.claims import Claim, all_claims
from scripts.written_pages import TITLES

PAGE = Path(__file__).parents[1] / "docs" / "repro.md"
EXAMPLE = "pymunk_rests_in_the_floor.py"
"""Script that the page shows in full; a short one."""


def page() -> str:
    """Return the text of the page."""
    claims = all_claims()
    sections = "\n".join(_section(TITLES[name], list(group)) for name, group in groupby(claims, lambda claim: claim.engine))
    (example,) = (claim.source for claim in claims if claim.file_name == EXAMPLE)
    return f"""# Claims that an engine's user can check

`python -m scripts.repro_page` writes this page from the scripts in `looping_pendulum/repro/scripts`; do not edit it by hand.
The [glossary](glossary.md) explains the terms.

What the [engine study](accuracy.md) finds in this package's apparatus, a script shows in a few lines without this package:
{len(claims)} claims, each in a file of at most 60 lines that needs the engine and NumPy only. Send one to the engine's
developers, or run it with your own version.

```sh
looping-pendulum repro mujoco                                 # list what is claimed
looping-pendulum repro mujoco --variant beads                 # only what concerns one variant
looping-pendulum repro mujoco --claim tendon_without_friction --out tendon.py
```

The script prints the closed form that it is judged by and the observed value. Its exit status is 1 while the claim holds, and
0 as soon as the engine's value is as near to the closed form as the column *mended within* says. The tests run every script
in a process that cannot import this package and compare what it prints with its head; where a setting cures it, they set that
and ask for status 0.

{sections}
## What a script looks like

```python
{example}```
"""


def _section(title: str, claims: list[Claim]) -> str:
    """Return the table of one engine."""
    head = ["`--claim`", "claim", "closed form", "observed", "mended within", "with", "variant", "hidden default"]
    rows = [
        [
            f"`{c.name}`",
            c.title,
            c.closed_form,
            _quantity(c.observed, c),
            _quantity(c.limit, c),
            f"{c.package} {c.version}",
            c.variant,
            ", ".join(c.defaults) or "–",
        ]
        for c in claims
    ]
    return f"## {title}\n\n{table(head, rows, left=len(head))}"


def _quantity(value: float, claim: Claim) -> str:
    return f"{value:.6g} {claim.unit}".rstrip()


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

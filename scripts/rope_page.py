"""Write docs/rope-over-a-cylinder.md and its figure from stored measurements and from the heads of the recipes.

python -m scripts.rope_page
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks import rope_budgets, stored_study
from benchmarks.pareto import MARK
from benchmarks.rope_budgets import BUDGETS, STATIC_ONLY, Candidate, best
from benchmarks.stored_study import EngineStudy
from looping_pendulum.compare.convergence.result import HALT, VariationStudy
from looping_pendulum.compare.export import write_atomically
from looping_pendulum.compare.plots import GREY, legend_below, make_figure, png
from looping_pendulum.compare.tables import GAP, fixed, number, signed, table
from looping_pendulum.pages.palette import styles
from looping_pendulum.repro.claims import RECIPES, Claim, all_claims
from scripts.engine_pages import TITLES

EARLY = "path_0.35s"
DOCS = Path(__file__).parents[1] / "docs"
PAGE, FIGURE = DOCS / "rope-over-a-cylinder.md", DOCS / "img" / "rope-over-a-cylinder.png"

FIRST_CLAIMS = ("exudyn_friction_is_ignored.py", "newton_string_does_not_slide.py", "rapier_chain_stretches.py")
"""Claims about the default to change first, for engines of which the stored study has no defaults."""


def page() -> str:
    """Return the text of the page."""
    study, rows = _stored()
    recipes = all_claims(RECIPES)
    sections = "\n".join(_section(name, list(group), study, rows) for name, group in groupby(recipes, lambda one: one.engine))
    return f"""# A rope over a cylinder, in every engine

`python -m scripts.rope_page` writes this page from `docs/data/engine_study.json`, `docs/data/rope_over_a_cylinder.json` and the
recipes in `looping_pendulum/repro/recipes`; do not edit it by hand. The [glossary](glossary.md) explains the terms.

A rope that slides over a cylinder obeys the capstan law, T2 = T1 exp(mu theta): friction grows with the tension and with the
angle of wrap. Few engines have a rope that does so by itself. This page says for each which settings come nearest to it at
three budgets of processor time, and has {len(recipes)} recipes, each a file of at most 60 lines that needs the engine and not
this package:

```sh
looping-pendulum recipe mujoco                                 # list the recipes for an engine
looping-pendulum recipe pymunk --variant chain --out rope.py   # write one
```

A recipe prints what it reaches beside the exact value, and its exit status is 0 while it reaches it. The tests run every recipe
in a process that cannot import this package.

## In short

- You want the right motion and may feed the law in: MuJoCo, one tendon over the cylinder and [the bound of its
  friction](#your-own-mujoco-model) at every step. Nothing else is as exact or as quick.
- You want the law from contact alone: beads without rotation on links of fixed length, with a friction coefficient corrected
  for the polygon that they are. {_best_contact(rows)}
- In any engine, test the static ratio first: a rope that slides with T2/T1 below exp(mu theta) is not solved well enough, and
  a chain of N corners may hold a little more, 2 N artanh(mu tan(theta / 2N)) instead of mu theta.

![Error until 0.7 s against processor time, for all settings that were measured](img/rope-over-a-cylinder.png)

The trial is ten to one: 10 g and 100 g on one string over a rod of 6.25 mm, mu = 0.3431. The rod catches the string after
{fixed(study.convergence.reference_values[HALT], 5)} s.

- *Path*: the root mean square distance of the light mass from the exact model up to 0.7 s. *Scatter*: how far small changes of
  the release move that error ([engine study](engine-study.md)); a chain's error below its scatter is luck.
- *Static ratio*: what the [static capstan test](verification.md) gives with these settings, ln(T2/T1) over mu theta, less 1.
- *Budget*: in *real time* a simulated second takes at most a second of processor time; the accurate settings may take any time.
- {GAP}: no setting that was measured halts the heavy mass at this budget, or this quantity was not measured.
- *{", ".join(STATIC_ONLY)}*: its run ends where the friction law would go wrong, before the heavy mass halts.
- *Settings* are this package's names, as changes of the variant's quick settings; the recipe shows what they are in the engine.

{sections}
## Your own MuJoCo model

`looping_pendulum.capstan.CapstanTendon` gives a tendon of your own `MjModel` the capstan law, sliding and sticking: with any
bodies on either side, motors, or an elastic string. Besides your tendon the model needs a second one, from the same first end
over the same cylinder to a site on the cylinder. That one carries MuJoCo's own friction loss, whose bound the class sets before
every step:

```python
import mujoco
from looping_pendulum.capstan import CapstanTendon

model = mujoco.MjModel.from_xml_path("winch.xml")
data = mujoco.MjData(model)
capstan = CapstanTendon(model, data, tendon="rope", side="side", friction=0.3)
while data.time < 1.0:
    capstan.prepare()
    mujoco.mj_step(model, data)
print(capstan.wrap_angle, capstan.tensions)
```

The [class](api/engines.md) shows the two tendons in MJCF. It counts no turns, because a
MuJoCo tendon counts none: one tendon is right up to about half a turn, and the recipe `mujoco --variant capstan` shows how two
of them, used in turn, go on from there. The variant `mujoco:capstan` of this package decides between sliding and sticking by
the same code.
"""


def figure() -> Figure:
    """Draw the error of every setting against its cost."""
    _, rows = _stored()
    picture, (axes,) = make_figure(8.4, 6.2)
    look = styles(rows)
    for variant in sorted(rows):
        mine = [row for row in rows[variant] if row.halting_time is not None]
        if not mine:
            continue
        style = look[variant]
        axes.plot(
            [row.cpu for row in mine], [1e3 * row.path for row in mine], style.marker, ms=4, color=style.colour, alpha=0.35
        )
        chosen = sorted({row for budget in BUDGETS.values() if (row := best(rows[variant], budget))}, key=lambda row: row.cpu)
        xy = [row.cpu for row in chosen], [1e3 * row.path for row in chosen]
        axes.plot(*xy, "-", marker=style.marker, ms=8, lw=1.2, color=style.colour, label=variant)
    for name, budget in list(BUDGETS.items())[:2]:
        axes.axvline(budget, color=GREY, lw=0.9, dashes=(1, 2))
        axes.annotate(name, (budget, 1), (-3, -3), xycoords=("data", "axes fraction"), textcoords="offset points", **RIGHT)
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds per simulated second", ylabel="RMS of the path to 0.7 s [mm]")
    axes.set_title("Error against cost: large marks are the best settings at each budget")
    legend_below(picture)
    return picture


RIGHT = {"ha": "right", "va": "top", "rotation": 90, "color": GREY, "fontsize": 8}
"""Text to the left of a line."""


def _stored() -> tuple[EngineStudy, dict[str, list[Candidate]]]:
    """Return the study, and variant -> its settings with their errors."""
    study = stored_study.read(stored_study.SUMMARY.read_text(encoding="utf-8"))
    return study, rope_budgets.candidates(study, _budgets())


def _budgets() -> rope_budgets.Budgets:
    return rope_budgets.read(rope_budgets.DATA.read_text(encoding="utf-8"))


def _best_contact(rows: dict[str, list[Candidate]]) -> str:
    """Return the best chain in real time, as a sentence."""
    chains = [best(rows[label], BUDGETS["real time"]) for label in rows if label.endswith((":chain", ":beads"))]
    row = min((row for row in chains if row is not None), key=lambda row: row.path)
    return f"In real time the best is {row.variant}, {number(row.path, 1e3, digits=2)} mm off until 0.7 s."


def _section(engine: str, recipes: list[Claim], study: EngineStudy, rows: dict[str, list[Candidate]]) -> str:
    """Return the section of one engine."""
    static = _budgets().static
    labels = [label for label in rows if label.startswith(f"{engine}:") and any(r.halting_time for r in rows[label])]
    head = ["variant", "budget", "settings", "static ratio [%]", "halting time [s]", "path [mm]", "scatter [mm]"]
    head.append("CPU s per s")
    scatter = {v.label: v.spread[MARK] for v in study.convergence.variants}
    cells = []
    for label in labels:
        for name, budget in BUDGETS.items():
            row = best(rows[label], budget)
            if row is None:
                cells.append([label, name, *[GAP] * 6])
                continue
            error = static.get(rope_budgets.label(label, row.settings))
            values = [signed(error, 1e2), fixed(row.halting_time, 5), number(row.path, 1e3)]
            values += [number(scatter.get(label), 1e3, digits=2), number(row.cpu, digits=2)]
            cells.append([label, name, row.settings or "its own", *values])
    for label in STATIC_ONLY:
        if label.startswith(f"{engine}:"):
            cells.append([label, "accurate", "its own", signed(static.get(label), 1e2), *[GAP] * 4])
    texts = "\n".join(map(_recipe, recipes))
    return f"""## {TITLES[engine]}

{table(head, cells, left=3)}
{_default_to_change(engine, study)}{_mistakes(engine)}
{texts}"""


def _default_to_change(engine: str, study: EngineStudy) -> str:
    """Return the hidden default that spoils the path most, as a sentence.

    If the stored study has none of this engine, the default is that of `FIRST_CLAIMS`; else it is empty.
    """
    found = [
        (v, one) for v in study.convergence.variants if v.engine == engine and v.variant != "defaults" for one in v.defaults
    ]
    if not found:
        claims = [claim for claim in all_claims() if claim.file_name in FIRST_CLAIMS and claim.engine == engine]
        return "".join(f"**Change first:** `{claim.defaults[0]}`, as {claim.title}\n\n" for claim in claims)
    v, one = max(found, key=lambda pair: _damage(pair[1]))
    left = one.run.rms[EARLY]
    result = (
        f"the path to 0.35 s is {number(left, 1e3, digits=2)} mm off, instead of {number(v.own.rms[EARLY], 1e3, digits=2)} mm"
        if one.run.ok and left is not None
        else f"the run ends: {one.run.why.rstrip('.')}"
    )
    return (
        f"**Change first:** `{one.what}`, {one.effect}, from {one.other} to {one.ours}. With {v.label} and this default alone "
        f"{result}.\n\n"
    )


def _damage(one: VariationStudy) -> float:
    """Return how far the path to 0.35 s is off with this default [m]; a run that breaks down is worse than any."""
    error = one.run.rms[EARLY]
    return error if one.run.ok and error is not None else float("inf")


def _mistakes(engine: str) -> str:
    """Return what goes wrong with the engine as it comes, from the claims about it."""
    claims = [claim for claim in all_claims() if claim.engine == engine]
    if not claims:
        return ""
    lines = "".join(f"- {claim.title} (`looping-pendulum repro {engine} --claim {claim.name}`)\n" for claim in claims)
    return f"**Never overlook** ([claims that you can check](repro.md)):\n\n{lines}"


def _recipe(recipe: Claim) -> str:
    """Return a recipe with what it reaches, folded."""
    unit = f" {recipe.unit}".rstrip()
    what = recipe.closed_form.partition(", ")[2]
    return f"""**Recipe** `looping-pendulum recipe {recipe.engine} --variant {recipe.variant}`:
{recipe.title} It reaches {recipe.observed:g}{unit} with {recipe.package} {recipe.version},
where {recipe.expected:g}{unit} is exact ({what}).

<details markdown="1"><summary>{recipe.file_name}</summary>

```python
{recipe.source}```

</details>
"""


def main() -> None:
    """Write page and figure."""
    PAGE.write_text(page(), encoding="utf-8")
    write_atomically(FIGURE, png(figure()))


if __name__ == "__main__":
    main()

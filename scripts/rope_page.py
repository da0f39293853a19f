"""Write docs/rope-over-a-cylinder.md and its figure from stored measurements and from the heads of the recipes.

python -m scripts.rope_page
"""

from pathlib import Path

from matplotlib.figure import Figure

from benchmarks import rope_budgets, stored_study
from benchmarks.engine_study_page import fold
from benchmarks.rope_budgets import BUDGETS, STATIC_ONLY, Candidate, best
from benchmarks.stored_study import MARK, EngineStudy, supplied_by_engine
from looping_pendulum.compare.convergence.result import HALT, VariationStudy
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import legend_below, make_figure, png
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import GAP, fixed, number, signed
from looping_pendulum.pages.palette import GREY, styles
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
    return f"""# A rope over a cylinder, in every engine

A rope that slides over a cylinder obeys the capstan law, T2 = T1 exp(mu theta): friction grows with the tension and with the
angle of wrap. Few engines have a rope that does so by itself. This page says what to do in each, and how near it comes. The
[glossary](glossary.md) explains the terms.

## What to do

1. **Ask whether the law must be the engine's own.** If it may be fed in, take MuJoCo: one tendon over the cylinder, and [the
   bound of its friction](#your-own-mujoco-model) at every step. No rope that holds by contact is as exact or as quick.
2. **If it must come from contact**, take beads without rotation on links of fixed length, with a friction coefficient
   corrected for the polygon that they are. {_best_contact(rows)}
3. **Copy a recipe** ([below](#recipes)) and change its masses and radius.
4. **Change the engine's worst default first** ([below](#the-default-to-change-first)), and read what else goes wrong in it:
   [claims that you can check](repro.md).
5. **Test the static ratio before anything that moves.** A rope that slides with T2/T1 below exp(mu theta) is not solved well
   enough. A chain of N corners may hold a little more: 2 N artanh(mu tan(theta / 2N)) instead of mu theta.

## How near, at which cost

![Error until 0.7 s against processor time, for all settings that were measured](img/rope-over-a-cylinder.png)

The trial is ten to one: 10 g and 100 g on one string over a rod of 6.25 mm, mu = 0.3431. The rod catches the string
after {fixed(study.convergence.reference_values[HALT], 5)} s. The error is the root mean square distance of the light
mass from the exact model up to 0.7 s. In *real time* a simulated second takes at most a second of processor time.

{_best_table(study, rows)}
{fold("Every engine: its best settings at each budget", _settings_table(study, rows))}
## The default to change first

{_defaults_table(study)}
## Recipes

A recipe is a file of at most 60 lines that needs the engine and not this package. The {len(recipes)} recipes are in
`looping_pendulum/repro/recipes`, and the command lists and writes them:

```sh
looping-pendulum recipe mujoco                                 # list the recipes for an engine
looping-pendulum recipe pymunk --variant chain --out rope.py   # write one
```

A recipe prints what it reaches beside the exact value, and its exit status is 0 while it reaches it. The tests run every recipe
in a process that cannot import this package.

{_recipes_table(recipes)}
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

`python -m scripts.rope_page` writes this page from `docs/data/engine_study.json`, `docs/data/rope_over_a_cylinder.json` and the
heads of the recipes; do not edit it by hand.
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


def _best_table(study: EngineStudy, rows: dict[str, list[Candidate]]) -> str:
    """Return a table of the nearest path at each budget, with a law that is fed in and with the engine's own."""
    own = {v.label for v in study.convergence.variants if supplied_by_engine(v)}
    cells = []
    for name, budget in BUDGETS.items():
        row = [name]
        for group in (rows.keys() - own, rows.keys() & own):
            found = [one for label in sorted(group) if (one := best(rows[label], budget)) is not None]
            nearest = min(found, key=lambda one: one.path)
            row.append(
                f"`{nearest.variant}`: {number(nearest.path, 1e3, digits=2)} mm for {number(nearest.cpu, digits=2)} CPU s per s"
            )
        cells.append(row)
    return table(["budget", "law fed in by the adapter", "law of the engine itself"], cells, left=3)


def _settings_table(study: EngineStudy, rows: dict[str, list[Candidate]]) -> str:
    """Return the table of every variant's best settings at each budget, and what its columns mean."""
    static = _budgets().static
    head = ["variant", "budget", "settings", "static ratio [%]", "halting time [s]", "path [mm]", "scatter [mm]"]
    head.append("CPU s per s")
    scatter = {v.label: v.spread[MARK] for v in study.convergence.variants}
    cells = []
    for label in (label for label in sorted(rows) if any(r.halting_time for r in rows[label])):
        for name, budget in BUDGETS.items():
            row = best(rows[label], budget)
            if row is None:
                cells.append([label, name, *[GAP] * 6])
                continue
            error = static.get(rope_budgets.label(label, row.settings))
            values = [signed(error, 1e2), fixed(row.halting_time, 5), number(row.path, 1e3)]
            values += [number(scatter.get(label), 1e3, digits=2), number(row.cpu, digits=2)]
            cells.append([label, name, row.settings or "its own", *values])
    cells += [[label, "accurate", "its own", signed(static.get(label), 1e2), *[GAP] * 4] for label in STATIC_ONLY]
    return f"""{table(head, cells, left=3)}
- *Settings* are this package's names, as changes of the variant's quick settings; the recipe shows what they are in the engine.
- *Static ratio*: what the [static capstan test](verification.md) gives with these settings, ln(T2/T1) over mu theta, less 1.
- *Scatter*: how far small changes of the release move the error of the path ([engine study](engine-study.md)); a chain's
  error below its scatter is luck.
- {GAP}: no setting that was measured halts the heavy mass at this budget, or this quantity was not measured.
- *{", ".join(STATIC_ONLY)}*: its run ends where the friction law would go wrong, before the heavy mass halts.
"""


def _defaults_table(study: EngineStudy) -> str:
    """Return a table of the hidden default of each engine that spoils the path most.

    If the stored study has none of an engine, the default is that of `FIRST_CLAIMS`.
    """
    cells = []
    for engine in dict.fromkeys(recipe.engine for recipe in all_claims(RECIPES)):
        # Where the run ends with the adapter's own settings, too, its defaults cannot be compared
        found = [
            (v, one)
            for v in study.convergence.variants
            if v.engine == engine and v.variant != "defaults" and v.own.ok
            for one in v.defaults
        ]
        if found:
            v, one = max(found, key=lambda pair: _damage(pair[1]))
            left = one.run.rms[EARLY]
            damage = (
                f"path to 0.35 s {number(left, 1e3, digits=2)} instead of {number(v.own.rms[EARLY], 1e3, digits=2)} mm off"
                if one.run.ok and left is not None
                else f"the run ends: {one.run.why.split(';')[0].rstrip('.')}"
            )
            cells.append([TITLES[engine], f"`{one.what}`: {one.effect}", one.other, one.ours, f"{damage} ({v.label})"])
        claims = [claim for claim in all_claims() if claim.file_name in FIRST_CLAIMS and claim.engine == engine]
        if claims and not found:
            cells += [[TITLES[engine], f"`{claim.defaults[0]}`", GAP, GAP, claim.title] for claim in claims]
    return table(["engine", "setting", "default", "change to", "with the default alone"], cells, left=5)


def _damage(one: VariationStudy) -> float:
    """Return how far the path to 0.35 s is off with this default [m]; a run that breaks down is worse than any."""
    error = one.run.rms[EARLY]
    return error if one.run.ok and error is not None else float("inf")


def _recipes_table(recipes: list[Claim]) -> str:
    """Return a table of what each recipe is, and of what it reaches."""
    cells = []
    for recipe in recipes:
        unit = f" {recipe.unit}".rstrip()
        reached = f"{recipe.observed:g} of {recipe.expected:g}{unit}"
        cells.append(
            [f"`{recipe.engine} --variant {recipe.variant}`", recipe.title, reached, recipe.closed_form.partition(", ")[2]]
        )
        cells[-1].append(f"{recipe.package} {recipe.version}")
    return table(["`looping-pendulum recipe`", "what hangs on what", "reaches", "quantity", "with"], cells, left=5)


def main() -> None:
    """Write page and figure."""
    PAGE.write_text(page(), encoding="utf-8")
    write_atomically(FIGURE, png(figure()))


if __name__ == "__main__":
    main()

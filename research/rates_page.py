"""Write the measured rates, research/rates.md and in short docs/identify.md, and draw docs/img/power.png.

`python -m research.calibration` measures and prints them; `python -m research.rates_page` writes texts and figure.
"""

import json
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import legend_below, make_figure, png
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import amount
from looping_pendulum.pages.palette import COLOURS
from research import DATA, FOLDER, IMAGES
from research.calibration_summary import HIDDEN, JUDGEMENTS, NAMED, TARGETS, Target
from tests.discrepancy.blind_sample import COUNTS

PAGE, IN_SHORT = FOLDER / "rates.md", FOLDER.parent / "docs" / "identify.md"
HEADING, NEXT = "## How reliable it is\n", "On real tracked points:\n"
"""Between these lines the second one has the page in short."""
WORDS_OF_NOISE = {"white": "white noise", "wander": "a tracker that wanders", "outliers": "outliers"}
LOOKS = {
    "right": ("named", "o", COLOURS[2]),
    "tied": ("tied with others", "s", COLOURS[0]),
    "none": ("nothing is named", "x", "0.55"),
    "wrong": ("something else is named", "v", COLOURS[1]),
}
"""Judgement -> its words, marker and colour in the figure."""
HIDDEN_HEAD = ("hidden", "the data show it", "of these named, or tied", "of the others", "else, where it is shown")
LARGEST = 1e3
"""Decimal logarithm of the odds beyond which a study is drawn at the edge."""
JITTER = 0.25
"""Largest shift of a marker in its row, so that studies of the same odds do not hide each other."""


def page(rates: dict[str, Any]) -> str:
    """Return the text of the page."""
    held_out = rates["held_out_error"]
    errors = f"{amount(held_out['0.5'])} in the median, {amount(held_out['largest'])} at most" if held_out else "-"
    clean = "\n".join(_clean_row(kind, rates["clean"][kind]) for kind in WORDS_OF_NOISE)
    return f"""# How reliable `identify` is

`python -m research.rates_page` writes this page from `research/data/calibration.json`; docs/identify.md has it in short.

{_studies(rates)}
In others no value gives the size that was drawn, or the reader of the files corrects what was hidden
({rates["unreachable"]}), or the search ended with an error ({rates["failed"]}). Where a fit with what was hidden did so
({rates["failed_known_answers"]}), the study counts as not showing it.

## What was asked of it

{_targets(rates)}

## What is hidden, and what is said

{table(HIDDEN_HEAD, _hidden_rows(rates))}
![What `identify` says of each hidden effect, against the odds by which the data show it](../docs/img/power.png)

{table(["hidden", "the light mass moves by (RMS)", "the data show it", "of these named, or tied"], _size_rows(rates), left=2)}
| nothing hidden | something is added | `unexplained` |
|---|---|---|
{clean}

Planted values within the stated 95 % interval, of effects that are named or tied: {share(rates["coverage"])}.
The held-out error where what is hidden is named or tied is {errors}, in units of the noise.

## Stated probabilities

Of all explanations that something is missing:

{table(["stated probability", "mean", "right", "right, where two things are hidden"], _probability_rows(rates))}"""


def in_short(rates: dict[str, Any]) -> str:
    """Return what docs/identify.md says of the rates."""
    return f"""
{_studies(rates)}

{_targets(rates)}

![What `identify` says of each hidden effect, against the odds by which the data show it](img/power.png)

"""


def _studies(rates: dict[str, Any]) -> str:
    planned, judged = sum(COUNTS.values()), rates["studies"]
    few = "" if judged + rates["unreachable"] + rates["failed"] >= planned else f" of {planned} that are planned"
    seconds, fitted = (
        f"{amount(q['0.5'])}{unit} in the median, {amount(q['largest'])} at most" if q else "-"
        for q, unit in ((rates["cpu_seconds"], " s"), (rates["explanations_fitted"], ""))
    )
    return f"""A separate simulator in Cartesian coordinates (`tests/blind`) made {judged} studies{few}, filmed by a
simulated camera with 1 to 4 trials and three kinds of noise; `identify` read only their files
(`{rates["command"]}`, {rates["measured_on"]}). An identification took a processor {seconds}, and the
explanations that it fitted are {fitted}. Intervals are of 95 %."""


def _targets(rates: dict[str, Any]) -> str:
    return f"""{table(["what", "asked", "measured", ""], [_target_row(t, rates) for t in TARGETS], left=4)}
Much of what an effect does, the fitted parameters can do as well: the wrong mass of a single trial is a friction. So every
study was also fitted with exactly what was hidden, begun at its true value, a law by its true formula. Its data *show* what is
hidden if that explanation, prior included, is at least 10 times as probable as every one that lacks a part of it.
"Named" is the only explanation with 95 % of the probability, "tied" one of several, of which one may be that nothing is
missing ({share(rates["perhaps_nothing"])} of those named or tied); of a law, what it acts on and what it depends on must be
right. A stated probability counts as right if its explanation is what was hidden, or the part of it that
the data show."""


def _target_row(target: Target, rates: dict[str, Any]) -> list[str]:
    measured = target.measured(rates)
    verdict = "not measured" if not measured["of"] else "met" if target.is_met(rates) else "not met"
    if verdict == "not met" and (why := _else_said(target.failures(rates))):
        verdict += f": {why}"
    return [target.what, target.asked, share(measured), verdict]


def _else_said(said: dict[str, int]) -> str:
    """Return what was said in studies in which the right explanation was not, in words."""
    return ", ".join(f"{words} in {said[j]}" for j, words in JUDGEMENTS.items() if j not in NAMED and said.get(j))


def _hidden_rows(rates: dict[str, Any]) -> list[list[str]]:
    return [
        [
            words,
            share(h["shown"]),
            share(h["named_of_shown"]),
            share(h["named_of_others"]),
            _else_said(h["said_of_shown"]) or "-",
        ]
        for key, words in HIDDEN.items()
        for h in [rates["hidden"][key]]
    ]


def _size_rows(rates: dict[str, Any]) -> list[list[str]]:
    return [
        [HIDDEN[key], f"{1e3 * float(size):g} mm", share(h["shown"]), share(h["named_of_shown"])]
        for key, sizes in rates["by_size"].items()
        for size, h in sizes.items()
        if h["shown"]["of"]
    ]


def _clean_row(kind: str, row: dict[str, Any]) -> str:
    return f"| {WORDS_OF_NOISE[kind]} | {share(row['additions'])} | {share(row['unexplained'])} |"


def _probability_rows(rates: dict[str, Any]) -> list[list[str]]:
    return [
        [f"{c['from']:g} to {c['to']:g}", f"{c['mean']:.2f}", share(c["right"]), share(c["right_where_two_are_hidden"])]
        for c in rates["probabilities"]
        if c["mean"] is not None
    ]


def share(numbers: dict[str, Any]) -> str:
    """Return a share with its interval; a dash if nothing was measured."""
    if not numbers["of"]:
        return "-"
    low, high = (100 * x for x in numbers["interval"])
    digits = 1 if high < 10 else 0
    return f"{numbers['count']} of {numbers['of']} ({low:.{digits}f} to {high:.{digits}f} %)"


def figure(studies: list[dict[str, Any]]) -> Figure:
    """Draw each study with one hidden effect or law as a marker in its row, by the odds by which the data show it."""
    known = [s for s in studies if len(s["hidden"]) == 1 and s["log10_odds"] is not None]
    effects = sorted({s["hidden"][0] for s in known}, reverse=True)
    picture, (axes,) = make_figure(8.0, 1.6 + 0.26 * len(effects), left=2.4)
    shifts = np.random.default_rng(0).uniform(-JITTER, JITTER, len(known))
    for judgement, (words, marker, colour) in LOOKS.items():
        chosen = [(study, shift) for study, shift in zip(known, shifts, strict=True) if study["judgement"] == judgement]
        odds = [min(study["log10_odds"], LARGEST) for study, _ in chosen]
        rows = [effects.index(study["hidden"][0]) + shift for study, shift in chosen]
        axes.plot(odds, rows, ls="none", marker=marker, ms=5.5, color=colour, label=f"{words} ({len(chosen)})")
    axes.axvline(1.0, color="black", lw=1.0)
    axes.set_yticks(range(len(effects)), [name.replace("_", " ") for name in effects])
    axes.set_xscale("symlog", linthresh=2.0)
    axes.set_xlabel("decimal logarithm of the odds by which a fit with the known answer shows it")
    axes.set_title(f"One hidden effect or law in {len(known)} blind studies: what is said of it")
    legend_below(picture)
    return picture


def main() -> None:
    """Write the page, what docs/identify.md has of it, and the figure."""
    rates = json.loads((DATA / "calibration.json").read_text(encoding="utf-8"))
    PAGE.write_text(page(rates), encoding="utf-8")
    before, _, rest = IN_SHORT.read_text(encoding="utf-8").partition(HEADING)
    _, after, rest = rest.partition(NEXT)
    IN_SHORT.write_text(before + HEADING + in_short(rates) + after + rest, encoding="utf-8")
    write_atomically(IMAGES / "power.png", png(figure(rates["each"])))


if __name__ == "__main__":
    main()

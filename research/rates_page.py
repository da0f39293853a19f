"""Write the measured rates, research/rates.md, from `calibration.json` and `rivals.json`, and draw docs/img/power.png.

`python -m research.calibration`, `research.known_answer`, `research.calibration --outliers` and `research.rivals` measure and
print them; `python -m research.rates_page` writes the text and the figure.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import legend_below, make_figure, png
from looping_pendulum.pages.numbers import amount
from looping_pendulum.pages.palette import COLOURS
from research import DATA, FOLDER, IMAGES
from research.calibration_summary import TARGETS, Target

PAGE = FOLDER / "rates.md"
HEAD = """# How reliable `identify` is

`python -m research.rates_page` writes this page from `research/data`; docs/identify.md has the results in short. A separate
simulator in Cartesian coordinates (`tests/blind`) made the studies, filmed by a simulated camera; `identify` read only files.
"""
SET, KNOWN_SET, SLOW_SET = "rates", "known_answer_rates", "all_free"
"""Keys of the stored results; the last one has few studies, for a method that takes more than a minute each."""
PLANNED = 800
"""Studies of the whole measurement: the benchmark's defaults."""
METHODS = {
    "all_free": "all candidates free in one lmfit fit",
    "forward_bic": "forward selection by BIC, no gate",
    "gaussian_process": "Gaussian-process discrepancy",
    "sindy": "PySINDy's STLSQ on smoothed points",
    "symbolic_regression": "symbolic regression (PyOperon) on smoothed points",
}
"""Other method -> its title."""
NOT_ASKED = "not asked for"
"""Why a method was not run that was left out on purpose."""
LOOKS = {
    "right": ("named", "o", COLOURS[2]),
    "tied": ("tied with others", "s", COLOURS[0]),
    "none": ("nothing is named", "x", "0.55"),
    "wrong": ("another is named", "v", COLOURS[1]),
}
"""Judgement -> its words, marker and colour."""
SMALLEST, LARGEST = 0.05, 200.0
"""Sizes over the smallest visible one beyond which a study is drawn at the edge."""
JITTER = 0.25
"""Largest shift of a marker in its row, so that studies of the same size do not hide each other."""


def page() -> str:
    """Return the text of the page."""
    stored, rivals = (json.loads((DATA / f"{name}.json").read_text(encoding="utf-8")) for name in ("calibration", "rivals"))
    parts = [
        HEAD,
        block(stored[SET]),
        known_answer_block(stored[KNOWN_SET]),
        targets_block(stored[SET]),
        outliers_block(stored["outliers"]),
        rivals_block(rivals[SET]),
        slow_rival(rivals[SLOW_SET]),
    ]
    return "\n".join(parts)


def block(rates: dict[str, Any]) -> str:
    """Return the sentence and the tables of one set of studies."""
    s = rates["summary"]
    planned = s["studies"] + s["unreachable"]
    few = f" of {PLANNED} that are planned"
    if planned >= PLANNED:
        few = f"; of the {planned} that were planned no value gives the size in the other {s['unreachable']}"
    few += ": too few for rates, as the intervals say" if s["studies"] < PLANNED / 2 else ""
    median, largest = (amount(s["cpu_seconds"][key]) for key in ("0.5", "largest"))
    rows = [
        *(_clean_row(kind, s["clean"][kind]) for kind in ("white", "wander", "outliers")),
        f"| one effect: another one is named instead | {share(s['single']['all']['wrong'])} |",
        f"| one effect of 16 mm or more: an unlisted force in its place | {share(s['large']['single_called_unlisted'])} |",
        f"| planted value within the stated 95 % interval, of named or tied effects | {share(s['coverage'])} |",
        "| something wrong is named, of all studies in which anything is named (false-discovery rate) "
        f"| {bounded(s['false_discoveries'])} |",
        f"| two effects: the pair is named or tied | {_named(s['two'])} |",
        f"| two effects: only one of them is named | {share(s['two']['part'])} |",
        f"| unlisted force: the verdict is `unlisted` | {share(s['unlisted_verdict'])} |",
        f"| unlisted force: it is named, or tied with others | {_named(s['unlisted'])} |",
        f"| unlisted force: what it acts on and depends on is as planted | {share(s['unlisted_law'])} |",
        f"| the same, of those with the verdict `unlisted` | {share(s['unlisted_law_of_found'])} |",
        f"| unlisted force: a listed effect is named instead | {share(s['unlisted']['wrong'])} |",
        f"| an effect beside an unlisted force: both are named or tied | {_named(s['mixed'])} |",
        f"| the same: one of the two, or the effect beside another force | {_partly(s['mixed'])} |",
    ]
    columns = ("named", "named_or_tied", "wrong")
    power = _power_rows(_in_millimetres(s["single"]["by_size"]), columns)
    visible = _power_rows(s["single"]["by_visibility"], columns)
    two_visible = _power_rows(s["two_by_visibility"], ("named_or_tied", "part", "wrong"))
    unlisted = _unlisted_table(s["unlisted_by_size"])
    stated = "\n".join(
        f"| {name} | {row['mean']:.2f} | {share(row['at_most_one'])} | {share(row['more'])} |"
        for name, row in s["stated_probabilities"].items()
    )
    return f"""These are {s["studies"]} studies{few}
(`{rates["command"]}`, {rates["measured_on"]}). An identification took {median} s of CPU time in the median,
{largest} s at most. Intervals are of 95 %, by Clopper and Pearson.

| what | share |
|---|---|
{chr(10).join(rows)}

The power of the search against the size of one hidden effect, of all kinds and noises:

| the light mass moves by (RMS) | named | named or tied | another is named |
|---|---|---|---|
{power}

Much of what an effect does, the fitted parameters can do as well: the wrong mass of a single trial is a friction. So the report
states the smallest size that the data could show. Against that size the power is:

![What `identify` says of each hidden effect, against its size over the smallest visible one](../docs/img/power.png)

| hidden size over the smallest visible one | named | named or tied | another is named |
|---|---|---|---|
{visible}

Of two hidden effects, against the visibility of the one that hides better:

| smaller ratio of hidden to visible size | both named or tied | only one of them | another is named |
|---|---|---|---|
{two_visible}
{unlisted}
The report states a probability of each explanation. Of all explanations that something is missing:

| stated probability | mean | right, of studies with one hidden effect or none | right, where two are hidden, or a law |
|---|---|---|---|
{stated}

What is hidden beside a right explanation but too small to be seen makes it count as wrong here: of two hidden things one alone
often counts as wrong."""


def _unlisted_table(by_size: dict[str, Any]) -> str:
    """Return what is said of forces that are not listed; empty if there was none in these studies."""
    if not by_size:
        return ""
    return f"""
Of a force that is not listed, against its size:

| the light mass moves by (RMS) | its law is named | the same, or tied | a listed effect is named instead |
|---|---|---|---|
{_power_rows(_in_millimetres(by_size), ("named", "named_or_tied", "wrong"))}
"""


def _power_rows(power: dict[str, Any], columns: Sequence[str]) -> str:
    """Return a row per class of studies, with the class and its shares."""
    return "\n".join(f"| {name} | {' | '.join(share(row[c]) for c in columns)} |" for name, row in power.items())


def _in_millimetres(by_size: dict[str, Any]) -> dict[str, Any]:
    """Return what is stored by size [m] by the size in words, the smallest first."""
    return {f"{1e3 * float(size):g} mm": by_size[size] for size in sorted(by_size, key=float)}


def _clean_row(kind: str, row: dict[str, Any]) -> str:
    words = {"white": "white noise", "wander": "a tracker that wanders", "outliers": "outliers"}[kind]
    added, unexplained = bounded(row["false_additions"]), share(row["unexplained"])
    return f"| clean, {words}: an effect is added; `unexplained` | {added}; {unexplained} |"


def bounded(numbers: dict[str, Any]) -> str:
    """Return a share with its one-sided bound; a dash if nothing was measured."""
    if not numbers["of"]:
        return "-"
    return f"{numbers['count']} of {numbers['of']}, below {100 * numbers['upper_bound']:.1f} %"


def _named(shares: dict[str, Any]) -> str:
    right, tied = shares["right"], shares["tied"]
    return f"{right['count']} named, {tied['count']} tied, of {right['of']}" if right["of"] else "-"


def _partly(shares: dict[str, Any]) -> str:
    count = shares["part"]["count"] + shares["law"]["count"]
    return f"{count} of {shares['part']['of']}" if shares["part"]["of"] else "-"


def share(numbers: dict[str, Any]) -> str:
    """Return a share with its interval; a dash if nothing was measured."""
    if not numbers["of"]:
        return "-"
    low, high = (100 * x for x in numbers["interval"])
    return f"{numbers['count']} of {numbers['of']} ({low:.0f} to {high:.0f} %)"


def known_answer_block(known: dict[str, Any]) -> str:
    """Return what a fit that is given the right answer shows, and how much of that was named."""
    kinds = {"single": "one effect", "two": "two effects", "unlisted": "a force that is not listed"}
    rows = [
        f"| {kinds[kind]} | {name} | {' | '.join(share(shares[column]) for column in shares)} |"
        for kind, sizes in known["summary"].items()
        if kind in kinds
        for name, shares in _in_millimetres({size: row for size, row in sizes.items() if size != "all"}).items()
    ]
    return f"""How much could be named at all? `{known["command"]}` ({known["measured_on"]})
fits the large ones of such studies, which `identify` has judged, with exactly what was hidden, begun at its
true value. The data *show* it if each hidden effect then has a delta BIC of 10 or more and, of a force that is not listed, 10
more than the listed effects that were named. What they do not show hardly any search
can name: the fitted parameters, or other effects, make up for it.

| hidden | the light mass moves by | the data show it | of these named or tied | of the others |
|---|---|---|---|---|
{chr(10).join(rows)}
"""


def targets_block(rates: dict[str, Any]) -> str:
    """Return what was asked of the search, and what the same studies measured."""
    rows = "\n".join(_target_row(target, rates["summary"]) for target in TARGETS)
    return f"""What was asked of the search before it was measured, of all designs of study alike. Rows for narrower
sets of studies were added later, with the same limits:

| what | asked | measured | |
|---|---|---|---|
{rows}
"""


def _target_row(target: Target, summary: dict[str, Any]) -> str:
    measured = target.measured(summary)
    if isinstance(measured, dict):
        words = bounded(measured) if "upper_bound" in measured else share(measured)
    else:
        words = "-" if measured is None else amount(measured, digits=3)
    verdict = "met" if target.is_met(summary) else f"not met{': ' if target.why_not else ''}{target.why_not}"
    return f"| {target.what} | {target.asked} | {words} | {verdict} |"


def outliers_block(outliers: dict[str, Any]) -> str:
    """Return what the search for outliers does to effects: with and without them, with and without the search."""
    words = {"white": "none", "outliers": "2 %, 30 mm off"}
    rows = []
    for r in outliers["rows"]:
        search, ratio = "yes" if r["finds_outliers"] else "no", r["standard_error_ratio"]
        shares = " | ".join(share(r[column]) for column in ("named_or_tied", "wrong", "unexplained"))
        rows.append(f"| {words[r['points']]} | {search} | {shares} | {'-' if ratio is None else amount(ratio)} |")
    return f"""Leaving points on another object out cost no power in a few studies (`{outliers["command"]}`,
{outliers["measured_on"]}; the same studies with one effect of 8 mm or more, judged four times; the last column is the median
of the stated standard errors over those in the first row):

| points on another object | looked for | named or tied | another is named | `unexplained` | standard error |
|---|---|---|---|---|---|
{chr(10).join(rows)}
"""


def rivals_block(rivals: dict[str, Any]) -> str:
    """Return the table of other methods on the same studies."""
    rows = []
    for method, r in rivals["methods"].items():
        held_out, seconds = ("-" if r[k] is None else amount(r[k]) for k in ("held_out_error", "cpu_seconds"))
        shares = " | ".join(share(r["single"][j]) for j in ("right", "tied", "wrong"))
        name = METHODS.get(method, f"`{method}`")
        rows.append(f"| {name} | {shares} | {share(r['clean']['wrong'])} | {held_out} | {seconds} |")
    not_run = "".join(
        f"\n- Not run: {method}: {reason}." for method, reason in rivals["not_run"].items() if reason != NOT_ASKED
    )
    return f"""Other methods on {rivals["studies"]} such studies (`{rivals["command"]}`,
{rivals["measured_on"]}); `identify` loses {len(rivals["losses_of_identify"])} that another one judges right.
The held-out error is the median, in units of the noise.

| method | one effect: right | tied | wrong | false alarms | held out | CPU s |
|---|---|---|---|---|---|---|
{chr(10).join(rows)}
{not_run}
"""


def slow_rival(few: dict[str, Any]) -> str:
    """Return what the fit of all candidates did on its few studies."""
    r = few["methods"]["all_free"]
    seconds = amount(r["cpu_seconds"])
    return f"""The fit of all candidates at once takes {seconds} s, so that it judged {few["studies"]} studies only
(`{few["command"]}`): something was missing in {r["detected"]["of"]}, and it said so in {r["detected"]["count"]}.
"""


def figure(studies: list[dict[str, Any]]) -> Figure:
    """Draw each study as a marker in the row of its effect, by the effect's size over the smallest visible one."""
    known = [study for study in studies if study["visibility"] is not None]
    effects = sorted({study["effect"] for study in known}, reverse=True)
    picture, (axes,) = make_figure(8.0, 1.6 + 0.26 * len(effects))
    shifts = np.random.default_rng(0).uniform(-JITTER, JITTER, len(known))
    for judgement, (words, marker, colour) in LOOKS.items():
        chosen = [(study, shift) for study, shift in zip(known, shifts, strict=True) if study["judgement"] == judgement]
        sizes = [np.clip(study["visibility"], SMALLEST, LARGEST) for study, _ in chosen]
        rows = [effects.index(study["effect"]) + shift for study, shift in chosen]
        axes.plot(sizes, rows, ls="none", marker=marker, ms=5.5, color=colour, label=f"{words} ({len(chosen)})")
    axes.axvline(1.0, color="black", lw=1.0)
    axes.set_yticks(range(len(effects)), [name.replace("_", " ") for name in effects])
    axes.set(xscale="log", xlabel="size of the hidden effect over the smallest that the data could show")
    axes.set_title(f"One hidden effect in {len(known)} blind studies: what the search says of it")
    legend_below(picture, columns=2)
    return picture


def main() -> None:
    """Write the page and its figure."""
    PAGE.write_text(page(), encoding="utf-8")
    rates = json.loads((DATA / "calibration.json").read_text(encoding="utf-8"))["rates"]
    write_atomically(IMAGES / "power.png", png(figure(rates["summary"]["single"]["each"])))


if __name__ == "__main__":
    main()

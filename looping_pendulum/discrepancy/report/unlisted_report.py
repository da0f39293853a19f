"""The unlisted force in words and as a figure, from the result object."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from looping_pendulum.compare.tables import GAP, number, table
from looping_pendulum.discrepancy.result import ForceProfile, Formula, Identification, Unlisted
from looping_pendulum.pages.palette import COLOURS

SIDES = {
    "along": "along the string, towards the rod",
    "across": "across the string, the way it loops",
    "heavy": "on the heavy mass, upward",
}


def section(result: Identification) -> str:
    """Return the section on the unlisted force; empty without one."""
    force = result.unlisted
    if force is None:
        return ""
    name = force.depends_on.replace("_", " ")
    unit = force.unit
    head = ["direction", f"largest at {name} [{unit}]", f"largest [{force_unit(force)}]", f"sure between [{unit}]", "formula"]
    rows = [[SIDES[p.side], number(p.largest_at), number(p.largest), _sure(p), f"`{p.formula}`"] for p in force.profiles]
    text = (
        "## The unlisted force\n\n"
        f"It acts on the {force.acts_on}, {force.phase}, and depends on the {name} (s below). It was found as a row of bumps "
        f"along that coordinate. {_standing(force)} *Sure*: the bumps are above two standard errors.\n\n"
        + table(head, rows, left=1)
        + (_numbers(force.formula) if force.formula else "")
        + f"\nTwice the log evidence gained by the bumps: {force.gain:.0f}. On data that no fit saw chi2 per value falls from "
        f"{force.held_out_before:.3f} to {force.held_out_after:.3f}.\n" + _formulas(force)
    )
    if not force.others:
        return text
    head = ["it acts on", "depends on", "multiplied by", "gain", "unseen chi2/n"]
    rows = [
        [o.acts_on, *(word.replace("_", " ") for word in (o.depends_on, o.multiplied_by)), number(o.gain), number(o.held_out)]
        for o in force.others
    ]
    return text + "\nOther coordinates and sides that were fitted as bumps:\n\n" + table(head, rows, left=3)


def _standing(force: Unlisted) -> str:
    f = force.formula
    if f is None:
        return "No simple formula explains unseen data as well as the bumps, so these are the model."
    return (
        f"The model is the formula, its numbers fitted to the trajectories together with all of the declared model: it gains "
        f"{f.gain:.0f} on the information criterion over the declared model and {f.gain - f.gain_of_bumps:.0f} over the bumps."
    )


def _numbers(formula: Formula) -> str:
    head = ["number", "value", "standard error", "unit"]
    rows = [[n.name.replace("_", ", "), number(n.value, digits=4), number(n.error, digits=2), n.unit] for n in formula.numbers]
    note = "Widths are standard deviations of a pulse; a pass is a force there and back around its place."
    return "\n" + table(head, rows, left=1) + f"\n{note}\n"


def _formulas(force: Unlisted) -> str:
    if not force.formulas:
        return ""
    head = ["formula", "depends on", "multiplied by", "stands?", "gain (BIC)", "bumps' gain", "unseen chi2/n", "bumps' chi2/n"]
    rows = [
        [f.form, *(word.replace("_", " ") for word in (f.depends_on, f.multiplied_by)), "yes" if f.stands else "no",
         f"{f.gain:.1f}", f"{f.gain_of_bumps:.1f}", number(f.held_out), number(f.held_out_of_bumps)]
        for f in force.formulas
    ]  # fmt: skip
    return "\nFormulas that were refitted by trajectory:\n\n" + table(head, rows, left=4)


def figure(force: Unlisted) -> Figure:
    """Bumps of every side with two standard errors, and the formula."""
    drawn = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes = drawn.subplots()
    axes.axhline(0.0, color="black", lw=0.8)
    for colour, p in zip(COLOURS, force.profiles, strict=False):
        s, value, error = np.array(p.coordinate), np.array(p.value), np.array(p.error)
        axes.fill_between(s, value - 2 * error, value + 2 * error, color=colour, alpha=0.25, lw=0)
        axes.plot(s, value, color=colour, label=SIDES[p.side])
        if p.written is not None:
            axes.plot(s, p.written, "--", color=colour, label="its formula")
    axes.set_xlabel(f"{force.depends_on.replace('_', ' ')} [{force.unit}]")
    axes.set_ylabel(f"unlisted force [{force_unit(force)}]")
    axes.legend(loc="best", fontsize=8)
    return drawn


def force_unit(force: Unlisted) -> str:
    """Unit of the unlisted force."""
    return "N" if force.multiplied_by == "constant" else "N s/m"


def _sure(p: ForceProfile) -> str:
    return GAP if p.sure_from is None else f"{number(p.sure_from)} and {number(p.sure_to)}"

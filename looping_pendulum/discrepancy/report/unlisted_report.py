"""Report the unlisted force, in words and as a figure, from the result object."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from looping_pendulum.compare.tables import GAP, number, table
from looping_pendulum.discrepancy.result import ForceProfile, Formula, Identification, Unlisted
from looping_pendulum.pages.drawing import new_figure
from looping_pendulum.pages.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIDES = {
    "along": "along the string, towards the rod",
    "across": "across the string, the way it loops",
    "heavy": "on the heavy mass, upward",
    "gradient": "the way in which the coordinate grows",
    "friction": "coefficient of friction",
}
"""Direction of a force (`ForceProfile.side`) -> words."""


IN_NO_REPAIRED_MODEL = "It is one of several explanations; the repaired model has the most probable one, without this force."


def section(result: Identification) -> str:
    """Return the section on the unlisted force; empty without one."""
    force = result.unlisted
    if force is None:
        return ""
    name = force.depends_on.replace("_", " ")
    unit = force.unit
    head = [
        "direction",
        f"largest at {name} [{unit}]",
        f"largest [{force.value_unit or 1}]",
        f"significant between [{unit}]",
        "formula",
    ]
    rows = [
        [SIDES[p.side], number(p.largest_at), number(p.largest), _significant_range(p), f"`{p.formula}`"]
        for p in force.profiles
    ]
    model = _model_in_words(force) if result.explanations[0].law else IN_NO_REPAIRED_MODEL
    text = (
        "## The unlisted force\n\n"
        f"It is a {force.in_words} (s in the formula), and acts {force.phase}. It was found as a sum of radial "
        f"basis functions of that coordinate. {model} "
        "*Significant*: above two standard errors.\n\n" + table(head, rows, left=1)
    )
    return text if force.formula is None else text + _parameters(force.formula)


def tests(force: Unlisted) -> str:
    """Return the tables of the numbers behind the unlisted force."""
    f = force.formula
    rows = [
        ["the model with radial basis functions over that without", "ln of the Bayes factor", number(force.log_bayes_factor)],
        ["declared model on held-out data", "chi2 per value", number(force.held_out_chi2_before)],
        ["repaired model on held-out data", "chi2 per value", number(force.held_out_chi2_after)],
    ]
    if f is not None:
        rows += [
            ["formula over the declared model", "delta BIC", number(f.delta_bic)],
            ["formula over the radial basis functions", "delta BIC", number(f.delta_bic - f.delta_bic_of_profile)],
        ]
    return "### The unlisted force\n\n" + table(["compared", "number", "value"], rows, left=2) + _formulas(force)


def _model_in_words(force: Unlisted) -> str:
    """Say whether the repaired model has the formula or the radial basis functions, and why."""
    if force.formula is None:
        return "The repaired model has these, since no simple formula explains held-out data as well."
    return (
        "The repaired model has the formula, which explains the data better than these; its parameters are fitted to the "
        "trajectories together with those of the declared model."
    )


def _parameters(formula: Formula) -> str:
    head = ["parameter", "value", "standard error", "unit"]
    rows = [
        [n.name.replace("_", ", "), number(n.value, digits=4), number(n.error, digits=2), n.unit] for n in formula.parameters
    ]
    note = (
        "A pulse is a Gaussian, whose width is its standard deviation; a pass is an odd pulse, which changes sign at its place."
    )
    return "\n" + table(head, rows, left=1) + f"\n{note}\n"


def _formulas(force: Unlisted) -> str:
    """Return the table of all refitted formulas; empty if there are none."""
    if not force.formulas:
        return ""
    head = ["formula", "depends on", "multiplied by", "accepted?", "delta BIC", "delta BIC of RBF", "held-out chi2/n", "of RBF"]
    rows = [
        [f.form, *(word.replace("_", " ") for word in (f.depends_on, f.multiplied_by)), "yes" if f.accepted else "no",
         f"{f.delta_bic:.1f}", f"{f.delta_bic_of_profile:.1f}", number(f.held_out_chi2), number(f.held_out_chi2_of_profile)]
        for f in force.formulas
    ]  # fmt: skip
    return (
        "\nFormulas that were refitted to the trajectories (RBF: the radial basis functions that each was fitted to):\n\n"
        + table(head, rows, left=4)
    )


def figure(force: Unlisted) -> Figure:
    """Draw the force in every direction with a band of two standard errors, and the formula."""
    chart = new_figure(8.0, 3.6)
    axes = chart.subplots()
    axes.axhline(0.0, color="black", lw=0.8)
    for colour, p in zip(COLOURS, force.profiles, strict=False):
        s, value, error = np.array(p.coordinate), np.array(p.value), np.array(p.error)
        axes.fill_between(s, value - 2 * error, value + 2 * error, color=colour, alpha=0.25, lw=0)
        axes.plot(s, value, color=colour, label=SIDES[p.side])
        if p.fitted_formula_values is not None:
            axes.plot(s, p.fitted_formula_values, "--", color=colour, label="its formula")
    axes.set_xlabel(f"{force.depends_on.replace('_', ' ')} [{force.unit}]")
    axes.set_ylabel(f"unlisted law [{force.value_unit or 1}]")
    axes.legend(loc="best", fontsize=8)
    return chart


def _significant_range(p: ForceProfile) -> str:
    return GAP if p.significant_from is None else f"{number(p.significant_from)} and {number(p.significant_to)}"

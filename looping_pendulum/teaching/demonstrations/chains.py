"""Demonstrations with chains of beads: what corners do to friction, and what a few sweeps of a solver do to a string."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from looping_pendulum.engines.pymunk import DEFAULT_RATE, PymunkChain
from looping_pendulum.engines.registry import how_to_get, missing_packages
from looping_pendulum.engines.tension import CapstanMeasurement, chain_capstan_exponent, measure_capstan_exponent
from looping_pendulum.errors import MissingPackageError
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.demonstrations.demonstration import (
    TEN_TO_ONE,
    Claim,
    Demonstration,
    DemonstrationCase,
    DemonstrationFigure,
    FigureCurve,
    MeasuredColumn,
    MeasuredValues,
    Runs,
    curves_over_time,
    reference_case,
    rms_distance,
    simulate,
)

FRICTION = 0.34
"""Friction coefficient between beads and rod."""
BENDS = (0.2, 0.4, 0.8, 1.2)
"""Angles between neighbouring links on the rod, link length over rod radius [rad]."""


def _measure_capstan(bend: float, corrected: bool) -> CapstanMeasurement:
    """Return the tension ratio of a chain of beads that slides over the rod with half a turn on it."""
    engine = PymunkChain().with_settings(bend=bend, polygon_friction=corrected)
    if missing_packages(engine):
        raise MissingPackageError(f"pymunk is not installed; to get it: {how_to_get('pymunk')}")
    return measure_capstan_exponent(engine, friction=FRICTION, wrap_angle=math.pi)


def _key(bend: float, corrected: bool) -> str:
    return f"{'c' if corrected else 'b'}{bend:g}"


def _exponent_error(runs: Runs, key: str) -> float:
    """Return the relative error of the exponent ln(T2 / T1) against mu theta [%]."""
    return 100 * float(runs[key].error)


def _formula_error(runs: Runs, key: str) -> float | None:
    """Return that error by the closed form of a chain with corners [%]; None where the friction was corrected for them."""
    if key.startswith("c"):
        return None
    point: CapstanMeasurement = runs[key]
    return 100 * (chain_capstan_exponent(FRICTION, point.wrap_angle, float(key[1:])) / point.ideal - 1)


def _is_near_formula(n: MeasuredValues) -> bool:
    """Return whether every measured error is within a fifth of the formula's, or within 0.2 %."""
    pairs = [(n["error"][key], value) for key, value in n["formula"].items() if value is not None]
    return all(abs(measured - formula) < max(0.2 * formula, 0.2) for measured, formula in pairs)


def _error_curves(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
    bends = np.linspace(0.02, BENDS[-1], 60)
    theta = float(runs[_key(BENDS[0], False)].wrap_angle)
    formula = np.array([100 * (chain_capstan_exponent(FRICTION, theta, float(b)) / (FRICTION * theta) - 1) for b in bends])
    measured = [
        FigureCurve(label=label, x=np.array(BENDS), y=np.array([_exponent_error(runs, _key(b, c)) for b in BENDS]), points=True)
        for c, label in ((False, "beads with friction mu"), (True, "beads, friction corrected for the corners"))
    ]
    return [FigureCurve(label="formula: 2 N artanh(mu tan(theta / 2N))", x=bends, y=formula, reference=True), *measured]


POLYGON = Demonstration(
    name="polygon",
    title="A polygon is not a circle",
    question="A chain of links over a rod is a polygon. Does it have the friction of a string over a circle?",
    guess="If the friction coefficient of the contact is right, the friction is right.",
    experiment=(
        f"pymunk's beads slide over the rod with half a turn on it, contact friction {FRICTION:g}. The two masses' "
        "accelerations give the tensions on either side, and so the exponent ln(T2 / T1), which for a string is mu theta. "
        "Links of four lengths, with the friction as it is, and corrected for the corners."
    ),
    scenario="ten_to_one",
    change="rod:\n  radius: 12.5 mm    # the same links bend half as much",
    commands=("looping-pendulum run mine.yaml --engine pymunk:chain",),
    cases=lambda: tuple(
        DemonstrationCase(
            key=_key(bend, corrected),
            label=f"links bent by {math.degrees(bend):.0f} deg{', corrected' if corrected else ''}",
            run=lambda bend=bend, corrected=corrected: _measure_capstan(bend, corrected),  # type: ignore[misc]
        )
        for corrected in (False, True)
        for bend in BENDS
    ),
    quantities=(
        MeasuredColumn(key="exponent", header="ln(T2 / T1)", measure=lambda runs, key: runs[key].exponent, digits=".4f"),
        MeasuredColumn(key="ideal", header="mu theta", measure=lambda runs, key: runs[key].ideal, digits=".4f"),
        MeasuredColumn(key="error", header="too large by [%]", measure=_exponent_error, digits="+.2f"),
        MeasuredColumn(key="formula", header="formula of a chain [%]", measure=_formula_error, digits="+.2f"),
    ),
    claims=(
        Claim(
            words="No. At a corner the chain presses on the rod more than a string does. With links bent by 46 deg the "
            "exponent is {error[b0.8]:.1f} % too large, with 23 deg {error[b0.4]:.1f} %, with 11 deg {error[b0.2]:.2f} %.",
            holds=lambda n: n["error"]["b0.8"] > 4 and n["error"]["b0.4"] > 1 and 0 < n["error"]["b0.2"] < n["error"]["b0.4"],
        ),
        Claim(
            words="Half the link, a quarter of the error: from 46 to 23 deg it falls by a factor {error[b0.8]:.2f} / "
            "{error[b0.4]:.2f}. A closed form of a chain with corners tells all four, to a fifth.",
            holds=lambda n: 3 < n["error"]["b0.8"] / n["error"]["b0.4"] < 5.5 and _is_near_formula(n),
        ),
        Claim(
            words="Once that is known, the contact's friction can be made smaller by as much: then {error[c0.8]:.2f} % are "
            "left at 46 deg and {error[c0.2]:.2f} % at 11 deg.",
            holds=lambda n: all(abs(n["error"][_key(b, True)]) < 0.3 * n["error"][_key(b, False)] for b in BENDS),
        ),
    ),
    picture=DemonstrationFigure(
        x="bend between two links on the rod [rad]",
        y="ln(T2 / T1) too large by [%]",
        caption="What corners add to the friction of a chain, by formula and as measured, and what is left after correcting "
        "for it.",
        curves=_error_curves,
    ),
    packages=("pymunk",),
)

STEP = 1e-4
"""Length of a step of the stretchy chains [s]."""
WATCHED_TIME = 0.1
"""Time from the release that is simulated [s]."""
SHORT_SCENARIO: Scenario = replace(TEN_TO_ONE, duration=WATCHED_TIME)


def _soft_chain_case(key: str, label: str, **changes: Any) -> DemonstrationCase:
    as_chipmunk_comes = {"impulse_leak": 0.0, "leak_interval": 1, "error_rate": DEFAULT_RATE}
    engine = PymunkChain().with_settings(time_step=STEP, force_interval=10, **as_chipmunk_comes, **changes)
    return DemonstrationCase(key=key, label=label, run=lambda: simulate(engine, SHORT_SCENARIO))


def _stretch(runs: Runs, key: str) -> float:
    """Return the largest stretch of the string [mm]."""
    return 1e3 * float(np.max(runs[key].string_stretch))


STRETCHY = Demonstration(
    name="stretchy-solver",
    title="A stretchy solver",
    question="The links of a chain have a fixed length. How long is the chain in a game engine that solves them one after "
    "the other?",
    guess="As long as the sum of its links: that is what a joint is for.",
    experiment=(
        f"pymunk's chain in the 10:1 trial, {1e3 * WATCHED_TIME:g} ms from the release, in steps of {1e3 * STEP:g} ms and with "
        "joints as Chipmunk has them. The solver goes over all joints so and so many times per step. First more sweeps, then "
        "heavier beads."
    ),
    scenario="ten_to_one",
    change="heavy:\n  mass: 20 g    # less to carry",
    commands=("looping-pendulum compare mine.yaml --engine pymunk:chain",),
    cases=lambda: (
        reference_case(SHORT_SCENARIO),
        _soft_chain_case("s10", "10 sweeps, beads of 0.02 % of M1", iterations=10),
        _soft_chain_case("s30", "30 sweeps, beads of 0.02 % of M1", iterations=30),
        _soft_chain_case("s100", "100 sweeps, beads of 0.02 % of M1", iterations=100),
        _soft_chain_case("m10", "10 sweeps, beads of 0.2 % of M1", iterations=10, bead_mass_ratio=2e-3),
        _soft_chain_case("m30", "10 sweeps, beads of 0.6 % of M1", iterations=10, bead_mass_ratio=6e-3),
    ),
    quantities=(
        MeasuredColumn(key="stretch", header="largest stretch [mm]", measure=_stretch, digits=".2f"),
        MeasuredColumn(
            key="off",
            header="M1 from the reference [mm]",
            measure=lambda runs, key: rms_distance(runs, key, "reference", WATCHED_TIME),
            digits=".2f",
        ),
    ),
    claims=(
        Claim(
            words="Longer. With 10 sweeps a step (the default) the string is {stretch[s10]:.0f} mm too long within a tenth "
            "of a second. A correction runs from joint to joint, and after a few sweeps it has not yet come from one end to "
            "the other: the chain is a spring.",
            holds=lambda n: n["stretch"]["s10"] > 5,
        ),
        Claim(
            words="More sweeps stiffen it: {stretch[s30]:.1f} mm with 30; but even 100 leave {stretch[s100]:.1f} mm.",
            holds=lambda n: (
                n["stretch"]["s30"] < 0.6 * n["stretch"]["s10"] and 0.1 < n["stretch"]["s100"] < n["stretch"]["s30"]
            ),
        ),
        Claim(
            words="Heavier beads stiffen it as well: {stretch[m10]:.1f} mm and {stretch[m30]:.1f} mm with 10 sweeps. But the "
            "string that was asked for has no mass.",
            holds=lambda n: n["stretch"]["m30"] < n["stretch"]["m10"] < 0.6 * n["stretch"]["s10"],
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="string too long by [mm]",
        caption="How much longer than its links the string is. Fewer sweeps and lighter beads make a softer spring.",
        curves=curves_over_time(lambda run: 1e3 * run.string_stretch),
    ),
)

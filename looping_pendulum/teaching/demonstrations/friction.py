"""Demonstrations about the string's friction on the rod, and about how a tendon is wound."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from looping_pendulum.engines.mujoco.model import DEFAULT_TIME_CONSTANT
from looping_pendulum.engines.mujoco.tendon import MUJOCO_DEFAULTS, FrictionSize, MujocoTendon, friction_loss
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.demonstrations.demonstration import (
    LARGEST_DROP,
    PARAMETERS,
    TEN_TO_ONE,
    Claim,
    Demonstration,
    DemonstrationCase,
    DemonstrationFigure,
    FigureCurve,
    MeasuredColumn,
    Runs,
    curves_over_time,
    drop_curves,
    first_index_apart,
    halting_time,
    halting_time_of,
    reference_case,
    rms_distance,
    simulate,
)


def _tendon_case(key: str, label: str, scenario: Scenario = TEN_TO_ONE, **options: Any) -> DemonstrationCase:
    """Return the case of a MuJoCo tendon with ``options``; the option ``changes`` holds changed settings."""
    changes = options.pop("changes", {})
    return DemonstrationCase(
        key=key, label=label, run=lambda: simulate(MujocoTendon(**options).with_settings(**changes), scenario)
    )


def _velocity_reversals(runs: Runs, key: str) -> int:
    """Return how often the heavy mass's velocity changes its sign, counting speeds above 2 cm/s only."""
    speed = runs[key].heavy_velocity[:, 1]
    signs = np.sign(speed[np.abs(speed) > 0.02])
    return int(np.count_nonzero(np.diff(signs)))


_SLIPPERY = replace(TEN_TO_ONE, parameters=PARAMETERS.replace(kinetic_friction=0.0))

TENDON_WITHOUT_FRICTION = Demonstration(
    name="tendon-without-friction",
    title="A tendon without friction never halts",
    question="MuJoCo's tendon wraps round a cylinder. Is that enough for the heavy mass to be caught?",
    guess="The tendon goes round the rod more and more often, so the heavy mass will be caught, a little later perhaps.",
    experiment=(
        "The 10:1 trial, four times: the exact reference; MuJoCo's tendon as its documentation describes it; the same "
        "tendon, to which the adapter gives the friction that the capstan law allows; and the reference with the friction "
        "set to 0."
    ),
    scenario="ten_to_one",
    change="string:\n  kinetic_friction: 0\n  static_friction: 0",
    commands=("looping-pendulum compare mine.yaml --engine mujoco:documented --engine mujoco:capstan",),
    cases=lambda: (
        reference_case(TEN_TO_ONE),
        _tendon_case("documented", "MuJoCo, as documented", variant="documented"),
        _tendon_case("capstan", "MuJoCo, capstan law fed in", variant="capstan"),
        reference_case(_SLIPPERY, "slippery", "reference without friction", main=False),
    ),
    quantities=(
        halting_time(PARAMETERS),
        LARGEST_DROP,
        MeasuredColumn(key="turns", header="times M2 turned round", measure=_velocity_reversals, digits="d"),
        MeasuredColumn(
            key="off",
            header="M1 from the reference to 0.35 s [mm]",
            measure=lambda runs, key: rms_distance(runs, key, "reference", 0.35),
            digits=".3f",
        ),
        MeasuredColumn(
            key="off_slippery",
            header="M1 from the reference without friction to 0.35 s [mm]",
            measure=lambda runs, key: rms_distance(runs, key, "slippery", 0.35),
            digits=".3f",
        ),
    ),
    claims=(
        Claim(
            words="No. The reference halts at {halt[reference]:.3f} s; the tendon as documented turns round "
            "{turns[documented]} times within a second and never rests.",
            holds=lambda n: (
                n["halt"]["documented"] is None and n["turns"]["documented"] >= 2 and n["halt"]["reference"] is not None
            ),
        ),
        Claim(
            words="The solver is not to blame. Up to 0.35 s it is {off_slippery[documented]:.3f} mm from the reference "
            "without friction, and {off[documented]:.0f} mm from the reference: it solved another problem, and solved it "
            "well.",
            holds=lambda n: n["off_slippery"]["documented"] < 0.05 * n["off"]["documented"],
        ),
        Claim(
            words="Give the same tendon the friction that the capstan law allows, and it halts at {halt[capstan]:.3f} s. "
            "That tests MuJoCo's mechanics, not the law: the law was fed in.",
            holds=lambda n: abs(n["halt"]["capstan"] - n["halt"]["reference"]) < 1e-3,
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="M2 has fallen by [cm]",
        caption="The heavy mass's way down. Without friction it comes up again and again; with friction it stays where it "
        "was caught.",
        curves=drop_curves,
    ),
)


def _friction(runs: Runs, key: str) -> float | None:
    """Return the constant friction of a case [N]; None for the reference."""
    return None if key == "reference" else friction_loss(PARAMETERS, FrictionSize[key.upper()])


def _reference_friction(at: str) -> Any:
    """Return a measure of the reference's friction [N] ``at`` "release" or "halt"."""

    def measure(runs: Runs, key: str) -> float | None:
        if key != "reference":
            return None
        run = runs["reference"]
        until = halting_time_of(run, PARAMETERS) if at == "halt" else 0.0
        assert until is not None
        i = int(until / 1e-3)
        return abs(float(run.heavy_tension[i] - run.light_tension[i]))

    return measure


CONSTANT_FRICTION = Demonstration(
    name="constant-friction",
    title="Constant friction is not a capstan",
    question="MuJoCo has a friction for tendons, a constant in newtons. Does one of the right size halt the heavy mass as "
    "the rod does?",
    guess="Friction is friction: with the right number it will come out about right.",
    experiment=(
        "The reference, and MuJoCo's tendon with its own constant friction loss in three sizes that the reference itself "
        "suggests: its friction at the release, its mean over the way that the string slides, and its friction just before "
        "the halt."
    ),
    scenario="ten_to_one",
    change="string:\n  kinetic_friction: 0.2    # or 0.5: how does the friction at the halt grow?",
    commands=("looping-pendulum compare mine.yaml --engine mujoco:frictionloss --engine mujoco:capstan",),
    cases=lambda: (
        reference_case(TEN_TO_ONE),
        *(
            _tendon_case(size.name.lower(), f"constant: {words}", variant="frictionloss", friction_size=size)
            for size, words in (
                (FrictionSize.AT_RELEASE, "as at the release"),
                (FrictionSize.EQUAL_WORK, "the mean"),
                (FrictionSize.AT_HALT, "as before the halt"),
            )
        ),
    ),
    quantities=(
        MeasuredColumn(key="friction", header="constant friction [N]", measure=_friction),
        MeasuredColumn(key="first", header="true friction at release [N]", measure=_reference_friction("release")),
        MeasuredColumn(key="last", header="true friction before the halt [N]", measure=_reference_friction("halt")),
        halting_time(PARAMETERS),
        LARGEST_DROP,
    ),
    claims=(
        Claim(
            words="None of the three. The small and the mean one never halt the heavy mass; the large one never lets it fall "
            "({lowest[at_halt]:.1f} cm).",
            holds=lambda n: (
                n["halt"]["at_release"] is None and n["halt"]["equal_work"] is None and n["lowest"]["at_halt"] < 0.1
            ),
        ),
        Claim(
            words="The reference's friction is no constant: {first[reference]:.2f} N at the release, {last[reference]:.2f} N "
            "before the halt. The capstan law multiplies what the light mass pulls by exp(mu theta); as the light mass whips "
            "round, both its pull and the angle on the rod grow.",
            holds=lambda n: n["last"]["reference"] > 5 * n["first"]["reference"],
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="M2 has fallen by [cm]",
        caption="The heavy mass's way down for the reference and three constants: two do not hold it, one is too strong to "
        "let it go.",
        curves=drop_curves,
    ),
)

UNREACHED_WRAP_ANGLE = 1e4
"""A wrap angle that no run reaches [rad], so that the adapter never changes tendons."""


def _wrap_angle_when_apart(limit: float) -> Any:
    """Return a measure of the reference's wrap angle [deg] when a run is first ``limit`` [m] away from it."""

    def measure(runs: Runs, key: str) -> float | None:
        if key == "reference":
            return None
        i = first_index_apart(runs[key], runs["reference"], limit)
        return None if i is None else math.degrees(runs["reference"].wrap_angle[i])

    return measure


def _stretch(runs: Runs, key: str) -> float:
    """Return the largest change of the string's length [mm]."""
    return 1e3 * float(np.nanmax(np.abs(runs[key].string_stretch)))


FORGOTTEN_TURNS = Demonstration(
    name="forgotten-turns",
    title="A tendon that forgets its turns",
    question="A tendon wraps round a cylinder on the side that its side site names. What does it know after a full turn?",
    guess="The engine follows the string all the way round, as often as it likes.",
    experiment=(
        "The reference; MuJoCo's tendon with the capstan law, where the adapter counts the turns and uses two tendons in "
        "turn; and the same with one tendon for everything, which is what one side site gives."
    ),
    scenario="ten_to_one",
    change="release:\n  angle: 60 deg    # more turns before the light mass reaches the rod",
    commands=("looping-pendulum run mine.yaml --engine mujoco:capstan",),
    cases=lambda: (
        reference_case(TEN_TO_ONE),
        _tendon_case("counted", "turns counted, two tendons in turn", variant="capstan"),
        _tendon_case("one", "one tendon, turns forgotten", variant="capstan", changes={"switch_up": UNREACHED_WRAP_ANGLE}),
    ),
    quantities=(
        halting_time(PARAMETERS),
        MeasuredColumn(
            key="apart",
            header="string on the rod when M1 is 1 mm off [deg]",
            measure=_wrap_angle_when_apart(1e-3),
            digits=".0f",
            absent="never",
        ),
        MeasuredColumn(key="stretch", header="largest error of the string's length [mm]", measure=_stretch),
        LARGEST_DROP,
    ),
    claims=(
        Claim(
            words="It knows nothing of turns: a tendon is the shortest way round at this instant. It follows the reference "
            "up to {apart[one]:.0f} deg of string on the rod; there another way becomes the shorter one, and without a "
            "warning its length is wrong by {stretch[one]:.0f} mm.",
            holds=lambda n: 180 < n["apart"]["one"] < 360 and n["stretch"]["one"] > 5,
        ),
        Claim(
            words="With the turns counted, the light mass is never 1 mm off and the length keeps to {stretch[counted]:.4f} mm.",
            holds=lambda n: n["apart"]["counted"] is None and n["stretch"]["counted"] < 0.01,
        ),
        Claim(
            words="The one tendon cannot halt the heavy mass as the reference does at {halt[reference]:.3f} s: it says "
            "{halt[one]:.3f} s.",
            holds=lambda n: n["halt"]["one"] is not None and abs(n["halt"]["one"] - n["halt"]["reference"]) > 0.02,
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="M1's height [cm]",
        caption="The light mass's height. With one tendon it leaves the reference before the first turn is complete.",
        curves=curves_over_time(lambda run: 100 * run.light_position[:, 1]),
    ),
)

CREEP_FROM, CREEP_TO = 0.45, 1.0
"""Start and end of the time in which the string sticks in the reference and in every case [s]."""


def _creep(runs: Runs, key: str) -> float:
    """Return how far the heavy mass moves from `CREEP_FROM` to `CREEP_TO` [mm], positive upward."""
    height = runs[key].heavy_position[:, 1]
    creep = 1e3 * float(height[round(CREEP_TO / 1e-3)] - height[round(CREEP_FROM / 1e-3)])
    return round(creep, 9) + 0.0  # rounding of the place is no creep, and would be shown as "-0.00000"


def _halting_delay(runs: Runs, key: str) -> float | None:
    """Return how much later than the reference a run halts [ms]."""
    own, true = halting_time_of(runs[key], PARAMETERS), halting_time_of(runs["reference"], PARAMETERS)
    return None if own is None or true is None or key == "reference" else 1e3 * (own - true)


def _curves_after_halt(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
    curves = []
    for key, case in cases.items():
        run = runs[key]
        seen = (run.t >= 0.36) & (run.t <= CREEP_TO)
        y = 1e3 * (run.heavy_position[:, 1] - run.heavy_position[:, 1].min())
        curves.append(FigureCurve(label=case.label, x=run.t[seen], y=np.minimum(y[seen], 10.0), reference=case.reference))
    return curves


_SOFT = {"impedance": MUJOCO_DEFAULTS.impedance, "least_impedance": MUJOCO_DEFAULTS.least_impedance}

CREEP = Demonstration(
    name="creeping-friction",
    title="A regularised friction creeps",
    question="A string that sticks does not move. Does a simulated one?",
    guess="Once the heavy mass is caught it stands still.",
    experiment=(
        "MuJoCo's friction is softened: the friction force is a smooth function of the sliding speed, so what is held must "
        "slide a little to be held. Two numbers set how much, a time constant and an impedance. The tendon with the capstan "
        f"law, with both made hard, with the default time constant of {1e3 * DEFAULT_TIME_CONSTANT:g} ms, and with both as "
        f"they come. Creep is measured from {CREEP_FROM:g} to {CREEP_TO:g} s, when the reference's string holds."
    ),
    scenario="ten_to_one",
    change="heavy:\n  mass: 60 g    # the string is held less tightly: does it creep more?",
    commands=("looping-pendulum compare mine.yaml --engine mujoco:capstan",),
    cases=lambda: (
        reference_case(TEN_TO_ONE),
        _tendon_case("hard", "1 ms, hard", variant="capstan"),
        _tendon_case("slow", "20 ms, hard", variant="capstan", changes={"friction_time_constant": DEFAULT_TIME_CONSTANT}),
        _tendon_case(
            "soft",
            "20 ms, soft (as it comes)",
            variant="capstan",
            changes={"friction_time_constant": DEFAULT_TIME_CONSTANT} | _SOFT,
        ),
    ),
    quantities=(
        halting_time(PARAMETERS),
        MeasuredColumn(key="late", header="late by [ms]", measure=_halting_delay, digits=".3f"),
        MeasuredColumn(key="creep", header="creeps while held [mm]", measure=_creep, digits="+.5f"),
        LARGEST_DROP,
    ),
    claims=(
        Claim(
            words="With the settings as they come it does not stand still, and so it never halts: the light mass, still "
            "whipping round, pulls it up by {creep[soft]:.1f} mm while it is held; the reference's string moves by "
            "{creep[reference]:.5f} mm.",
            holds=lambda n: n["halt"]["soft"] is None and n["creep"]["soft"] > 0.5 and abs(n["creep"]["reference"]) < 1e-6,
        ),
        Claim(
            words="The time constant alone makes the halt {late[slow]:.0f} ms late.",
            holds=lambda n: n["late"]["slow"] is not None and n["late"]["slow"] > 10,
        ),
        Claim(
            words="Hard settings bring the creep down to {creep[hard]:.5f} mm and the halt to {late[hard]:.3f} ms.",
            holds=lambda n: abs(n["creep"]["hard"]) < 1e-3 and abs(n["late"]["hard"]) < 0.1,
        ),
    ),
    picture=DemonstrationFigure(
        x="time [s]",
        y="M2 above its lowest point [mm]",
        caption="The heavy mass after it was caught. Softened friction lets it creep up; the reference stands still.",
        curves=_curves_after_halt,
    ),
)

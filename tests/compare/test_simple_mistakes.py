"""Runs with one planted mistake each: what a report must say of it, and that it says nothing of others."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.report import comparison_markdown
from looping_pendulum.engines.reference import Reference
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.scenario import Scenario
from tests.compare.conftest import PARAMETERS

SCENARIO = Scenario(name="exact", title="Exact", description="", parameters=PARAMETERS, duration=1.05)
TIMES = np.arange(1051) * 1e-3
GRAVITY = 9.81
CAUSE = "Likely cause: "


@pytest.fixture(scope="module")
def exact():
    """The exact motion as an engine's run."""
    return dataclasses.replace(Reference(SCENARIO)(TIMES), engine="planted", variant="mistake", profile="quick", events=())


def engine_of(run, scenario=SCENARIO):
    return compare(scenario, Reference(scenario), [run]).engines[0]


def moved(run, matrix):
    """The run with its positions and velocities (light x and y, heavy x and y) multiplied by a matrix."""
    position, velocity = (
        np.hstack([getattr(run, f"light_{what}"), getattr(run, f"heavy_{what}")]) @ np.array(matrix, dtype=float).T
        for what in ("position", "velocity")
    )
    return dataclasses.replace(
        run,
        light_position=position[:, :2],
        heavy_position=position[:, 2:],
        light_velocity=velocity[:, :2],
        heavy_velocity=velocity[:, 2:],
    )


def displaced(run, acceleration):
    """The run with a constant acceleration (light x and y, heavy x and y) from the place of the release."""
    t, a = run.t[:, None], np.array(acceleration)
    start = np.hstack([run.light_position[0], run.heavy_position[0]])
    position, velocity = start + 0.5 * a * t**2, a * t
    return dataclasses.replace(
        run,
        light_position=position[:, :2],
        heavy_position=position[:, 2:],
        light_velocity=velocity[:, :2],
        heavy_velocity=velocity[:, 2:],
    )


def test_the_exact_motion_has_no_mistake(exact):
    story = engine_of(exact).story
    assert story.startswith("Stays within 1 mm of the reference up to 1.050 s")
    assert "velocities" not in story


@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        (
            1e3 * np.eye(4),
            "its positions are 1000 times the exact ones at the release: they are in mm, and should be in metres.",
        ),
        (1e2 * np.eye(4), "its positions are 100 times the exact ones at the release: they are in cm,"),
        (1e-3 * np.eye(4), "its positions are 0.001 times the exact ones at the release: they are in km,"),
        (
            np.diag([1, -1, 1, -1]),
            "its heights have the wrong sign at the release: its y axis points down, and should point up.",
        ),
        (np.diag([-1, 1, -1, 1]), "its x has the wrong sign at the release: its x axis points left,"),
        (np.eye(4)[[1, 0, 3, 2]], "its axes are exchanged at the release"),
        (np.eye(4)[[2, 3, 0, 1]], "its masses are exchanged at the release"),
    ],
)
def test_units_and_axes_are_named_by_the_state_at_the_release(exact, matrix, said):
    story = engine_of(moved(exact, matrix)).story
    assert CAUSE + said in story
    assert "velocities" not in story, "they are changed in the same way"
    assert "time step" not in story


def test_a_shifted_start_is_named(exact):
    shift = np.array([3e-3, -4e-3])
    both = dataclasses.replace(
        exact, light_position=exact.light_position + shift, heavy_position=exact.heavy_position + 2 * shift
    )
    said = "its heavy mass begins 10 mm and its light mass begins 5 mm from where it is released"
    assert CAUSE + said in engine_of(both).story


@pytest.mark.parametrize(("mass", "moves"), [("heavy", "3.4 mm"), ("light", "5.3 mm")])
def test_a_mass_that_never_moves_is_no_run_within_a_millimetre(exact, mass, moves):
    """A heavy mass at rest was "within 1 mm" beside a light one that follows the exact path."""
    still = {f"{mass}_position": np.repeat(getattr(exact, f"{mass}_position")[:1], len(TIMES), axis=0)}
    still |= {f"{mass}_velocity": np.zeros((len(TIMES), 2))}
    story = engine_of(dataclasses.replace(exact, **still)).story
    assert story.startswith("First deviates by more than 1 mm at 0.0")
    assert f"{CAUSE}its {mass} mass stays at its release, where the exact one moves by {moves} in 30 ms." in story


def release(friction):
    """Accelerations at the release, by Newton's second law for both masses; the two tensions are in the ratio exp(mu theta)."""
    p, theta = PARAMETERS, PARAMETERS.release_angle
    ratio = math.exp(friction * theta)
    # Along the string M1 a = T1 + M1 g cos theta, heavy M2 a = M2 g - T1 ratio, with a the speed at which the string slides
    matrix = [[p.light_mass, -1.0], [p.heavy_mass, ratio]]
    slide, _ = np.linalg.solve(matrix, [p.light_mass * GRAVITY * math.cos(theta), p.heavy_mass * GRAVITY])
    along, across = np.array([math.sin(theta), -math.cos(theta)]), np.array([-math.cos(theta), -math.sin(theta)])
    light = slide * along + GRAVITY * math.sin(theta) * across
    return (*light, 0.0, -slide)


@pytest.mark.parametrize(
    ("acceleration", "said"),
    [
        ((0, GRAVITY, 0, GRAVITY), "gravity acts upward: its sign is wrong."),
        (release(-0.34), "the string's friction drives it in place of braking it: its sign is wrong."),
        (release(0.0), "it moves as without the string's friction."),
    ],
)
def test_signs_and_laws_are_named_by_the_first_motion(exact, acceleration, said):
    assert CAUSE + said in engine_of(displaced(exact, acceleration)).story


def test_what_is_wrong_later_or_otherwise_has_no_name(exact):
    late = exact.light_position + np.outer(TIMES > 0.3, [0.5, 0.0])
    for other in (displaced(exact, 1.1 * np.array(release(0.34))), dataclasses.replace(exact, light_position=late)):
        assert CAUSE + "it" not in engine_of(other).story.replace("its string", "")


def test_a_string_is_as_long_as_the_positions_say(exact):
    """The engine says that it has not stretched; the light mass is put half a metre away at 0.3 s."""
    direction = exact.light_position / np.linalg.norm(exact.light_position, axis=1)[:, None]
    off = dataclasses.replace(exact, light_position=exact.light_position + 0.5 * (TIMES > 0.3)[:, None] * direction)
    engine = engine_of(off)
    assert engine.metrics["string_stretch"] == pytest.approx(0.5, abs=0.01)
    assert (
        "Likely cause: its string had stretched by up to 499 mm by then." in engine.story or "by up to 500 mm" in engine.story
    )
    assert engine_of(exact).metrics["string_stretch"] < 1e-8


def test_a_shorter_string_is_slack_and_not_stretched(exact):
    inward = dataclasses.replace(exact, light_position=0.9 * exact.light_position)
    assert engine_of(inward).metrics["string_stretch"] < 1e-8


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1e3, "Its velocities are in mm/s, and should be in m/s."),
        (-1.0, "Its velocities have the wrong sign."),
        (0.0, "Its velocities are zero."),
        (1.5, "Its velocities differ from the slopes of its positions, by 50 % of them."),
        (1e308, "Its velocities are no numbers, or above 1e+09 m/s."),
        (math.nan, "Its velocities are no numbers, or above 1e+09 m/s."),
    ],
)
def test_velocities_that_are_no_slopes_of_the_positions_are_said(exact, factor, said):
    with np.errstate(over="ignore"):
        wrong = dataclasses.replace(exact, light_velocity=factor * exact.light_velocity)
    if factor in (1e3, -1.0, 0.0, 1.5):
        wrong = dataclasses.replace(wrong, heavy_velocity=factor * exact.heavy_velocity)
    assert said in engine_of(wrong).story


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("first", [0, 400])
def test_positions_of_1e308_are_no_motion_and_no_warning(exact, first):
    """They gave five warnings of NumPy."""
    huge = exact.light_position.copy()
    huge[first:] = 1e308
    result = compare(SCENARIO, Reference(SCENARIO), [dataclasses.replace(exact, light_position=huge)])
    (engine,) = result.engines
    assert engine.metrics["rms_0.7s"] is None
    said = "No motion to compare: its first sample is no number, or above 1e+09 m." if first == 0 else "up to 0.399 s"
    assert said in engine.story
    assert comparison_markdown(result)


def test_a_vertical_release_has_its_signs_too():
    vertical = dataclasses.replace(
        SCENARIO, parameters=PARAMETERS.replace(release=Release.VERTICAL, release_angle=math.pi), duration=0.3
    )
    run = dataclasses.replace(Reference(vertical)(TIMES[:301]), engine="planted", events=())
    ratio = math.exp(-0.34 * math.pi)
    rate = GRAVITY * (0.1 - 0.01 * ratio) / (0.1 + 0.01 * ratio)
    assert "in place of braking it" in engine_of(displaced(run, (0, rate, 0, -rate)), vertical).story

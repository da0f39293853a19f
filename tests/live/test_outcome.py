"""How a run ends, in words: the page says what Python says, and what it says is what happens."""

import re

import numpy as np
import pytest

from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.outcome import outcome
from tests.live.cases import live_settings

COUNT = 300
DURATION = {Release.DROP: 0.6}
"""Longest time that the page watches a run [s], where it is not 5 s."""


def setting(number):
    """Return an apparatus within the range of the page's controls; a third of them with much friction, a third with little."""
    rng = np.random.default_rng([67, number])
    kinetic = float(rng.choice([0.0, rng.uniform(0.0, 0.3), rng.uniform(0.3, 1.0)]))
    release = (Release.LOOPING, Release.LOOPING, Release.LOOPING, Release.VERTICAL, Release.HELD, Release.DROP)[number % 6]
    light_mass = rng.uniform(5e-3, 50e-3)
    return Parameters(
        light_mass=light_mass,
        heavy_mass=light_mass * rng.uniform(1.0, 12.0),
        rod_radius=rng.uniform(3e-3, 20e-3),
        free_length=rng.uniform(0.2, 1.0),
        release_angle=np.pi if release is Release.VERTICAL else np.radians(rng.uniform(20.0, 170.0)),
        release=release,
        coefficients={
            "kinetic_friction": kinetic,
            "static_friction": kinetic * float(rng.choice([1.0, rng.uniform(1.0, 1.6)])),
            "light_drag": float(rng.choice([0.0, rng.uniform(0.0, 3e-3)])),
        },
    )


HELD_AT_FIRST, IN_STEPS = (
    Parameters(
        light_mass=0.01,
        heavy_mass=0.01,
        rod_radius=5e-3,
        free_length=0.5,
        release_angle=np.radians(140.0),
        coefficients={"kinetic_friction": kinetic, "static_friction": 0.115},
    )
    for kinetic in (0.05, 0.115)
)
"""40 deg, phi, from the vertical: cos(phi) exp(mu (pi - phi)) > 1 holds it, until 3 - 2 cos(phi) > exp(mu pi) at the bottom."""
SETTINGS = [*map(setting, range(COUNT - 2)), HELD_AT_FIRST, IN_STEPS]


def run_of(p):
    return solve(p, duration=DURATION.get(p.release, 5.0), tolerance=1e-9)


@pytest.fixture(scope="module")
def sentences():
    return [outcome(run_of(p)) for p in SETTINGS]


def test_the_page_says_the_same(node, sentences):
    said = node("outcomes.mjs", [live_settings(p) for p in SETTINGS])
    assert [each["en"].replace("\u00a0", " ") for each in said] == sentences
    numbers = [[re.findall(r"\d+[.,]?\d*", each[language]) for language in ("en", "de")] for each in said]
    assert all([n.replace(",", ".") for n in german] == english for english, german in numbers)


def test_every_kind_of_sentence_is_among_them(sentences):
    kinds = {re.sub(r"[\d.]+", "#", sentence) for sentence in sentences}
    falling = ("halts after", "never halts", "does not halt within", "falls without a halt", "slides again")
    held = ("Nothing moves", "at first, but not", "moves in steps", "swings on, and so it is", "clamped", "Without a string")
    for part in falling + held:
        assert any(part in kind for kind in kinds), part


def test_what_it_says_is_what_happens(sentences):
    """Judged by samples alone: where the heavy mass is said to stand still, it does not move by a micrometre; else it moves."""
    for p, sentence in zip(SETTINGS, sentences, strict=True):
        if p.release in (Release.HELD, Release.DROP):
            continue
        samples = solve_at(p, np.linspace(0.0, 5.0, 5001), duration=5.0)
        t, drop = samples.t, np.asarray(samples.run.heavy_drop(samples.state))
        end = samples.run.end_time
        if "Nothing moves" in sentence:
            assert np.ptp(drop) < 1e-9
            assert np.ptp(samples.light_position, axis=0).max() < 1e-9
            continue
        if found := re.match(r"The heavy mass halts after ([\d.]+) s, ([\d.]+) cm (below|above)", sentence):
            still = t >= float(found[1]) + 1e-4
            sign = 1 if found[3] == "below" else -1
            assert np.ptp(drop[still]) < 1e-6
            assert drop[-1] == pytest.approx(sign * float(found[2]) / 100, abs=6e-4)
        elif found := re.match(r"The heavy mass stands still after ([\d.]+) s, but not for good: after ([\d.]+) s", sentence):
            begin, until = float(found[1]) + 1e-3, float(found[2]) - 1e-3
            meanwhile = drop[(t >= begin) & (t <= until)]
            assert np.all(np.abs(meanwhile - meanwhile[:1]) < 1e-6)
            # It may be a microsecond before the light mass reaches the rod, where its pull grows beyond all bounds
            last = solve_at(p, np.linspace(until, end, 100), duration=5.0)
            assert np.ptp(last.run.heavy_drop(last.state)) > (1e-6 if end - until > 5e-3 else 0.0)
        elif "so it is until the end" in sentence:
            begin = float(found[1]) if (found := re.match(r"The heavy mass stands still after ([\d.]+)", sentence)) else 0.0
            assert np.ptp(drop[t >= begin + 1e-3]) < 1e-6
            assert end == pytest.approx(5.0)
            assert ("swings on" in sentence) == bool(np.ptp(samples.light_position[t > end - 2.0], axis=0).max() > 1e-6)
        elif found := re.match(r"The heavy mass moves in steps: (\d+) times .*, the last time after ([\d.]+) s", sentence):
            held = samples.mode == Mode.STICKING
            assert held[0] + np.count_nonzero(held[1:] & ~held[:-1]) == int(found[1])
            assert held[t >= float(found[2]) + 1e-3].all()
        elif found := re.match(r"The rod holds the string at first, but not for good: after ([\d.]+) s", sentence):
            assert np.ptp(drop[t <= float(found[1]) - 1e-3]) < 1e-9
            assert np.ptp(drop) > 1e-6
        else:
            assert not np.any(samples.mode == Mode.STICKING), sentence
            assert "never halts" in sentence or "does not halt" in sentence or "falls without" in sentence

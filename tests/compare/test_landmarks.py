"""Landmarks of whole runs against closed forms, and against the reference's own events."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare.landmarks import reference_landmarks
from looping_pendulum.engines.landmarks import extrema, run_landmarks
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference, ReferenceEngine
from looping_pendulum.engines.trajectory import RunStatus

DT = 1e-3


def test_landmarks_of_the_closed_form(closed_form, make_run):
    for status, confirmed in ((RunStatus.FINISHED, False), (RunStatus.LIGHT_REACHED_ROD, True)):
        landmarks = run_landmarks(make_run(status=status), closed_form.parameters)
        assert landmarks.halting_time == pytest.approx(closed_form.halt, abs=1e-9)
        assert landmarks.halting_confirmed is confirmed
        assert landmarks.drop_at_halt == pytest.approx(closed_form.drop, abs=5e-6)  # b dt^2 / 8, between samples
        assert landmarks.wrap_angle_at_halt == pytest.approx(closed_form.wrap_angle, abs=1e-4)
        assert landmarks.free_length_at_halt == pytest.approx(closed_form.free_length, abs=5e-6)


def test_reference_speaks_by_its_own_events(closed_form, reference, times):
    landmarks = reference_landmarks(reference, times)
    assert [s.time for s in landmarks.stops] == [closed_form.halt]
    assert landmarks.halting_time == closed_form.halt
    assert landmarks.drop_at_halt == pytest.approx(closed_form.drop, rel=1e-12)
    assert landmarks.wrap_angle_at_halt == pytest.approx(closed_form.wrap_angle, rel=1e-12)
    assert landmarks.light_reaches_rod == 1.1


def test_a_run_cut_just_after_a_stop_does_not_halt(closed_form, make_run):
    landmarks = run_landmarks(make_run(until=closed_form.halt + 0.04), closed_form.parameters)
    assert landmarks.halting_time is None
    assert len(landmarks.stops) == 1
    assert landmarks.rebound is None
    assert run_landmarks(make_run(until=0.0), closed_form.parameters).stops == ()


def test_extrema_of_a_cosine():
    t, rate = np.arange(1100) * DT, 9.0
    turns = extrema(t, 0.2 * np.cos(rate * t + 0.5))
    expected = [(k * math.pi - 0.5) / rate for k in (1, 2, 3)]
    assert [e.time for e in turns] == [pytest.approx(e, abs=1e-6) for e in expected]  # the parabola misses by order dt^3 rate^2
    assert [e.value for e in turns] == [pytest.approx(v, abs=1e-8) for v in (-0.2, 0.2, -0.2)]


def test_the_references_samples_give_the_references_events(scenario):
    """Two to one: a reversal, a stick, a break-away and the halt, read off samples at 1 kHz."""
    coefficients = {"kinetic_friction": 0.265, "light_drag": 6e-4, "heavy_drag": 6e-4, "string_drag": 5.9e-3}
    parameters = scenario.parameters.replace(
        light_mass=0.05, rod_radius=0.007, free_length=0.584, release_angle=math.radians(68), **coefficients
    )
    two = dataclasses.replace(scenario, parameters=parameters, duration=1.2)
    exact = reference_landmarks(Reference(two), np.arange(1201) * DT)
    landmarks = run_landmarks(ReferenceEngine("scipy", Profile.QUICK).simulate(two), parameters)
    assert len(landmarks.stops) == len(exact.stops) == 3
    for own, true in zip(landmarks.stops, exact.stops, strict=True):
        assert own.time == pytest.approx(true.time, abs=5e-4)  # the speed's curvature over the last two samples
    assert landmarks.halting_time == pytest.approx(exact.halting_time, abs=1e-4)
    assert len(landmarks.slip_onsets) == len(exact.slip_onsets) == 1
    assert landmarks.slip_onsets[0] == pytest.approx(exact.slip_onsets[0], abs=4e-3)  # the power law's next term
    assert [e.time for e in landmarks.x1_extrema] == [pytest.approx(e.time, abs=1e-6) for e in exact.x1_extrema]

"""The capstan law measured on any engine that has the protocol, by the tensions of a string that just slides."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.runs.tension import string_impulses
from looping_pendulum.scenarios.scenario import Scenario

LIGHT_MASS = 0.01
"""Light mass of the test [kg]."""
FREE_LENGTH = 0.4
"""Free length at release [m]."""
OVERLOAD = 2.0
"""Heavy mass over the largest one that the rod holds. Nearer to 1 is more nearly static, but slides over fewer links."""
DURATION = 0.15
"""Time over which tensions are averaged [s]."""
MIN_SLIDE_FRACTION = 0.01
"""Smallest slide that is accepted, as a fraction of free fall in the same time.

With less, the tensions have the ratio of the weights, whatever the rod does, within 0.02 of ln(T2 / T1). Strings that stick
move by rounding errors (1e-13 of free fall) up to the creep of soft contacts (3e-3).
"""
MIN_WRAP_ANGLE, MAX_WRAP_ANGLE = math.radians(85), math.radians(275)
"""Limits of the wrap angle between which the released light mass keeps its string taut [rad]."""


@dataclass(frozen=True, kw_only=True)
class CapstanMeasurement:
    """Result of one measurement."""

    friction: float
    """Coefficient mu between string and rod."""
    wrap_angle: float
    """Wrap angle, averaged over the time with the tension on the light side as weight [rad]."""
    exponent: float
    """Measured ln(T2 / T1) of the tensions averaged over the time."""
    slide_length: float
    """Length of string that passed over the rod in that time [m]."""

    @property
    def ideal(self) -> float:
        """Return the exponent of the capstan law, mu theta."""
        return self.friction * self.wrap_angle

    @property
    def error(self) -> float:
        """Return the relative error of the measured exponent."""
        return self.exponent / self.ideal - 1


def measure_capstan_exponent(
    engine: Engine,
    *,
    friction: float = 0.34,
    wrap_angle: float = math.pi,
    rod_radius: float = 6.25e-3,
    free_length: float = FREE_LENGTH,
    overload: float = OVERLOAD,
    duration: float = DURATION,
) -> CapstanMeasurement:
    """Measure the tension ratio that ``engine`` makes of ``friction`` over ``wrap_angle`` [rad].

    The string is only just slipping: the heavy mass exceeds the largest mass that the rod holds by the factor ``overload``, so
    that it slides slowly from rest. ln(T2 / T1) is then compared with mu theta, and with that of a chain of N corners.

    Both tensions follow from Newton's law for the masses, averaged over ``duration`` [s] of sliding: the heavy one's from its
    change of velocity, the light one's from its change of velocity along the string. As the light mass swings, the wrap angle
    changes by some degrees; its mean, weighted with the light mass's tension, is used. As T2 = T1 exp(mu theta) at every
    moment, the neglected term is half the square of mu times the angle's spread: 1e-3 of the exponent at 90 deg, less above.

    Raises
    ------
    EngineError
        If the wrap angle lets the string go slack, the run failed, or the string slid by less than `MIN_SLIDE_FRACTION`.
    """
    if not MIN_WRAP_ANGLE <= wrap_angle <= MAX_WRAP_ANGLE:
        raise EngineError(
            f"static capstan test: found a wrap angle of {math.degrees(wrap_angle):g} deg, needed one from "
            f"{math.degrees(MIN_WRAP_ANGLE):g} to {math.degrees(MAX_WRAP_ANGLE):g} deg, between which the string is taut"
        )
    p = Parameters(
        light_mass=LIGHT_MASS,
        heavy_mass=overload * LIGHT_MASS * math.exp(friction * wrap_angle),
        rod_radius=rod_radius,
        free_length=free_length,
        release_angle=wrap_angle,
        coefficients={"kinetic_friction": friction},
    )
    scenario = Scenario(name="static_capstan", title="", description="", parameters=p, duration=duration)
    run = engine.simulate(scenario).raise_if_failed()
    slide_length = float(run.heavy_drop[-1])
    min_slide_length = MIN_SLIDE_FRACTION * 0.5 * p.coefficients["gravity"] * duration**2
    if not slide_length >= min_slide_length:
        raise EngineError(
            f"{run.label}: static capstan test: found a string that did not slide ({slide_length * 1e3:.2g} mm), "
            f"needed a slide of {min_slide_length * 1e3:.2g} mm; raise overload above {overload:g}"
        )
    light, heavy = string_impulses(run, p)
    return CapstanMeasurement(
        friction=friction,
        wrap_angle=float(np.average(0.5 * (run.wrap_angle[1:] + run.wrap_angle[:-1]), weights=light)),
        exponent=math.log(float(heavy.sum() / light.sum())),
        slide_length=slide_length,
    )


def chain_capstan_exponent(contact_friction: float, wrap_angle: float, bend: float) -> float:
    """Return ln(T2 / T1) of a massless chain on a circle, 2 N artanh(m tan(theta / 2N)), with N = theta / bend corners.

    ``contact_friction`` m is the coefficient of the contacts, which an adapter may have corrected for the corners.
    """
    corners = wrap_angle / bend
    return 2 * corners * math.atanh(contact_friction * math.tan(bend / 2))

"""The capstan law by itself: what ratio of tensions a rod holds apart, measured of any engine through its protocol alone.

The string is at the edge of slipping: the heavy mass outweighs what the rod holds by a set factor, so that the string creeps
over the rod from rest. Weight and measured acceleration of either mass give the tension on either side, without a word from the
engine about its forces. What an engine's contact makes of ln(T2 / T1) stands beside mu theta, and beside what a chain of N
corners should make of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.tension import string_impulses
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios.scenario import Scenario

LIGHT_MASS = 0.01
"""[kg]"""
FREE_LENGTH = 0.4
"""[m]"""
DRIVE = 2.0
"""Heavy mass over the one that the rod just holds. Nearer to 1 is more nearly static, but slides over fewer links."""
DURATION = 0.15
"""Time over which tensions are averaged [s]."""
LEAST_SLIDE = 0.01
"""Least slide over free fall in the same time. With less, the tensions have the ratio of the weights, whatever the rod does,
within 0.02 of ln(T2 / T1). Strings that stick move by rounding (1e-13 of free fall) up to what soft contacts creep (3e-3).
"""
LEAST_ANGLE, GREATEST_ANGLE = math.radians(85), math.radians(275)
"""Wrap angles between which the released light mass keeps its string taut [rad]."""


@dataclass(frozen=True, kw_only=True)
class CapstanPoint:
    """One measurement."""

    friction: float
    """Coefficient mu between string and rod."""
    wrap_angle: float
    """Angle over which the string lay on the rod, on average over what the light mass pulled [rad]."""
    exponent: float
    """ln(T2 / T1), of tensions averaged over the time."""
    slid: float
    """String that passed over the rod meanwhile [m]."""

    @property
    def ideal(self) -> float:
        """Exponent of the capstan law, mu theta."""
        return self.friction * self.wrap_angle

    @property
    def error(self) -> float:
        """Exponent over the ideal one, less 1."""
        return self.exponent / self.ideal - 1


def measured_exponent(
    engine: Engine,
    *,
    friction: float = 0.34,
    wrap_angle: float = math.pi,
    rod_radius: float = 6.25e-3,
    drive: float = DRIVE,
    duration: float = DURATION,
) -> CapstanPoint:
    """Measure the tension ratio that ``engine`` makes of ``friction`` over ``wrap_angle`` [rad].

    Both tensions follow from Newton's law for the masses, averaged over ``duration`` [s] of sliding: the heavy one's from its
    change of velocity, the light one's from its change of velocity along the string. As the light mass swings, the wrap angle
    changes by some degrees; its mean, weighted with the light mass's tension, is what counts: as T2 = T1 exp(mu theta) at every
    moment, what is neglected is half the square of mu times the angle's spread, 1e-3 of the exponent at 90 deg and less above.

    Raises
    ------
    EngineError
        If the wrap angle lets the string go slack, the run failed, or the string slid by less than `LEAST_SLIDE`.
    """
    if not LEAST_ANGLE <= wrap_angle <= GREATEST_ANGLE:
        raise EngineError(
            f"static capstan test: found a wrap angle of {math.degrees(wrap_angle):g} deg, needed one from "
            f"{math.degrees(LEAST_ANGLE):g} to {math.degrees(GREATEST_ANGLE):g} deg, between which the string is taut"
        )
    p = Parameters(
        light_mass=LIGHT_MASS,
        heavy_mass=drive * LIGHT_MASS * math.exp(friction * wrap_angle),
        rod_radius=rod_radius,
        free_length=FREE_LENGTH,
        release_angle=wrap_angle,
        coefficients={"kinetic_friction": friction},
    )
    scenario = Scenario(name="static_capstan", title="", description="", parameters=p, duration=duration)
    run = engine.simulate(scenario).raise_if_failed()
    slid = float(run.heavy_drop[-1])
    least = LEAST_SLIDE * 0.5 * p.coefficients["gravity"] * duration**2
    if not slid >= least:
        raise EngineError(
            f"{run.label}: static capstan test: found a string that did not slide ({slid * 1e3:.2g} mm), "
            f"needed a slide of {least * 1e3:.2g} mm; raise drive above {drive:g}"
        )
    light, heavy = string_impulses(run, p)
    return CapstanPoint(
        friction=friction,
        wrap_angle=float(np.average(0.5 * (run.wrap_angle[1:] + run.wrap_angle[:-1]), weights=light)),
        exponent=math.log(float(heavy.sum() / light.sum())),
        slid=slid,
    )


def chain_exponent(contact_friction: float, wrap_angle: float, bend: float) -> float:
    """ln(T2 / T1) of a massless chain that touches a circle where it bends: 2 N artanh(m tan(theta / 2N)), N = theta / bend.

    ``contact_friction`` m is what the contacts were given, which an adapter may have corrected for the corners.
    """
    corners = wrap_angle / bend
    return 2 * corners * math.atanh(contact_friction * math.tan(bend / 2))

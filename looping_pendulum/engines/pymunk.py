"""pymunk (Chipmunk): the string as a chain of point-mass beads that slides over a static circle under Coulomb friction."""

from __future__ import annotations

import importlib
import importlib.metadata
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import lay_chain, polygon_friction
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Abilities, Engine, Profile, SteppedEngine
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class ChainSettings:
    time_step: float
    link_length: float
    iterations: int = 10
    long_range: int = 64
    bead_radius: float = 1e-3
    contact_slop: float = 1e-5
    error_rate: float = 100.0
    impulse_leak: float = 200.0
    contact_push: float = 0.1
    force_interval: int = 10
    mass_fraction: float = 0.01
    comp: float = 0.4
    polyr: bool = True
    shapes_all: bool = True


class Rig:
    def __init__(self, p, s):
        import pymunk
        from pymunk._chipmunk import lib
        self.lib = lib
        self.s = s
        self.p = p
        sp = self.space = pymunk.Space()
        sp.iterations = s.iterations
        sp.gravity = (0, -p.coefficients["gravity"])
        sp.damping = 1
        sp.collision_slop = s.contact_slop
        sp.collision_bias = (1 - s.contact_push) ** (1 / s.time_step)
        sp.collision_persistence = 3
        R = p.rod_radius
        L = p.string_length
        n = round(L / s.link_length)
        h = L / n
        if s.polyr:
            b = h / R; Rb = h / (2 * math.sin(b / 2))
        else:
            Rb = R; b = 2 * math.asin(h / 2 / R)
        mu = polygon_friction(p.coefficients["kinetic_friction"], b)
        arcs = np.linspace(0, L, n + 1)
        P = []
        w = R * p.release_angle
        for q in arcs:
            if q < p.free_length:
                P.append(light_position(math, p.free_length - q, p.release_angle, R))
            elif q < p.free_length + w:
                P.append(light_position(math, 0., p.release_angle - (q - p.free_length) / R, Rb))
            else:
                P.append((R, -(q - p.free_length - w)))
        circ = pymunk.Circle(sp.static_body, Rb - s.bead_radius + s.contact_slop)
        circ.friction = mu
        sp.add(circ)
        F = pymunk.ShapeFilter(group=1)
        cm = s.mass_fraction * p.light_mass
        self.bodies = []
        self.keep = []
        for i, q in enumerate(P):
            m = p.light_mass - s.comp * cm if i == 0 else p.heavy_mass if i == n else cm / n
            bd = pymunk.Body(m, math.inf)
            bd.position = q
            sp.add(bd)
            self.bodies.append(bd)
            if 0 < i < n:
                c = pymunk.Circle(bd, s.bead_radius); c.friction = 1; c.filter = F; sp.add(c)
        eb = math.exp(-s.error_rate)
        self.rest = 0
        for i in range(n):
            j = pymunk.PinJoint(self.bodies[i], self.bodies[i + 1]); j.error_bias = eb
            j.collide_bodies = False
            self.rest += j.distance
            sp.add(j)
        lv = 2
        while lv <= s.long_range:
            for i in range(0, n - lv + 1, lv):
                j = pymunk.SlideJoint(self.bodies[i], self.bodies[i + lv], (0, 0), (0, 0), 0, lv * h)
                j.error_bias = eb; j.collide_bodies = False
                sp.add(j)
            lv *= 2
        self.force = cartesian_force(p)
        self.k = 0
        self.L = self.bodies[0]._body; self.H = self.bodies[-1]._body; self.S = sp._space
        self.spi = round(SAMPLE_INTERVAL / s.time_step)

    def advance(self):
        lib = self.lib; s = self.s
        step = lib.cpSpaceStep; setdt = lib.cpSpaceSetCurrentTimeStep
        S = self.S; dt = s.time_step; warm = dt / (1 - s.impulse_leak * dt)
        n = s.force_interval
        for k in range(self.spi):
            if k % n == 0 and self.force:
                a = lib.cpBodyGetPosition(self.L); v = lib.cpBodyGetVelocity(self.L); hv = lib.cpBodyGetVelocity(self.H)
                fx, fy, hf = self.force(0., a.x, a.y, v.x, v.y, hv.y)
                lib.cpBodySetForce(self.L, (n * fx, n * fy)); lib.cpBodySetForce(self.H, (0, n * hf))
            setdt(S, warm)
            step(S, dt)

    def read(self):
        lib = self.lib
        a = lib.cpBodyGetPosition(self.L); v = lib.cpBodyGetVelocity(self.L)
        c = lib.cpBodyGetPosition(self.H); w = lib.cpBodyGetVelocity(self.H)
        xs = np.array([b.position for b in self.bodies])
        st = np.linalg.norm(np.diff(xs, axis=0), axis=1).sum() - self.rest
        return a.x, a.y, v.x, v.y, c.x, c.y, w.x, w.y, st


_ENGINE = Supplier.ENGINE
SUP = Supplies(winding=Supply(by=_ENGINE, how=""), friction_law=Supply(by=_ENGINE, how=""), stick_slip=Supply(by=_ENGINE, how=""), drag=Supply(by=Supplier.ADAPTER, how=""))


class PymunkChain(SteppedEngine):
    name = "pymunk"
    variant = "chain"

    def __init__(self, settings):
        self.settings = settings
        self.profile = Profile.QUICK
        self.abilities = Abilities(releases=frozenset(Release), supplies=SUP, packages=("pymunk",), summary="")

    def build(self, scenario):
        return Rig(scenario.parameters, self.settings)

    def versions(self):
        return {}

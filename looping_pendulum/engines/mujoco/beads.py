"""MuJoCo variant with the string as beads that slide over a cylinder; all friction is MuJoCo's own Coulomb contact.

Beads are added where the straight string will touch the rod, and removed where it has left it. A bead on a straight part bears
no transverse force, so adding or removing one there changes no force; the beads that touch the rod are left to MuJoCo alone. A
free bead would oscillate transversely like one on a musical string, and would need steps shorter than that oscillation; so no
bead stays free for longer than it takes to reach the rod.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import (
    MIN_BEADS,
    NO_STOP,
    ONE_COEFFICIENT,
    STRAIGHT_STRING,
    BeadCountRule,
    Point,
    SlipGauge,
    bead_abilities,
    bend_rungs,
    point_on_string,
    polygon_friction,
    polygon_radius,
)
from looping_pendulum.engines.mujoco.model import (
    breakdown_warnings,
    compile_model,
    softness_rungs,
    solver_defaults,
    time_constant_default,
)
from looping_pendulum.engines.protocol import Profile, TunedEngine, groups_per_sample
from looping_pendulum.engines.studies import Studies, studies_from_rows
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class BeadSettings:
    """Numerical settings of the bead chain."""

    time_step: float
    """Time step [s]; it divides the sample interval."""
    bend: float
    """Angle between neighbouring links on the rod [rad]; a link is R times this long."""
    bead_mass_ratio: float
    """Mass of one bead over the light mass.

    Lighter beads need shorter steps; with heavier ones the string's own inertia becomes visible.
    """
    contact_time_constant: float = 1e-4
    """Time constant with which contacts and their friction come to rest [s]; MuJoCo's `solref`."""
    string_time_constant: float = 1e-4
    """Time constant with which links return to their length [s]; MuJoCo's `solref`."""
    least_contact_impedance: float = 0.99
    """Impedance of a contact where bead and rod just touch: the fraction enforced at once; MuJoCo's `solimp`."""
    contact_impedance: float = 0.9999
    """Impedance of a contact at a penetration of half a millimetre."""
    string_impedance: float = 0.9999
    """Impedance of the links; MuJoCo's `solimp`."""
    cone: str = "elliptic"
    """Shape of the friction cone; with a pyramidal one the string stretches by millimetres, and nothing halts."""
    friction_to_normal_impedance: float = 100.0
    """Ratio of the impedance of friction to that of the normal force; MuJoCo's `impratio`."""
    integrator: str = "implicitfast"
    jacobian: str = "sparse"
    """A sparse Jacobian takes a third of the time of a dense one.

    MuJoCo 4.0.0 factorizes some sparse Hessians wrongly; a test shows that a chain's is not among them.
    """
    solver: str = "Newton"
    solver_iterations: int = 20
    solver_tolerance: float = 1e-10
    bead_radius: float = 1e-3
    """Radius of a bead [m]; the rod's cylinder is thinner by it, so that the bead's centre runs where the string should."""
    steps_per_group: int = 20
    """Steps between two updates of the drag forces and of the number of beads; a test shows that it may be 1."""
    polygon: bool = True
    """Whether radius and friction coefficient are corrected for the polygon that represents the circle (`engines.chain`)."""

    def __post_init__(self) -> None:
        """Refuse a time step that does not divide the sample interval."""
        groups_per_sample(self.time_step, self.steps_per_group)

    @property
    def groups_per_sample(self) -> int:
        """Return the number of groups of steps in one sample interval."""
        return groups_per_sample(self.time_step, self.steps_per_group)

    def node_radius(self, rod_radius: float) -> float:
        """Return the distance of a bead on the rod from the rod's centre [m]."""
        return float(polygon_radius(rod_radius, self.bend)) if self.polygon else rod_radius

    def contact_friction(self, friction: float) -> float:
        """Return the friction coefficient of the contacts for a string with the coefficient ``friction``."""
        return polygon_friction(friction, self.bend) if self.polygon else friction


SETTINGS = {
    Profile.QUICK: BeadSettings(time_step=1e-5, bend=0.28, bead_mass_ratio=2e-4),
    Profile.ACCURATE: BeadSettings(
        time_step=2.5e-6,
        bend=0.28,
        bead_mass_ratio=1e-4,
        contact_time_constant=5e-5,
        string_time_constant=3e-5,
        steps_per_group=40,
    ),
}


def bead_xml(parameters: Parameters, settings: BeadSettings, beads: int) -> str:
    """Return the MuJoCo model (MJCF): light mass, ``beads`` beads and heavy mass in a row, each but the last on two slides.

    Joint coordinates are x and y (MuJoCo's x and z) from the rod's centre, the heavy mass's is y. Links between beads are
    equality constraints of their length; the straight parts, tendon 0 and the last, are upper limits. The rig sets all lengths.
    """
    p, s = parameters, settings
    has_string, held = p.release is not Release.DROP, p.release is Release.HELD
    heavy_mass_position = (p.rod_radius, -p.hanging_length if held else 0.0)
    bodies = [_body("light", p.light_mass, site="site0")]
    bodies += [
        _body(f"bead{i}", s.bead_mass_ratio * p.light_mass, site=f"site{i}", geom=_sphere(i, s.bead_radius))
        for i in range(1, beads + 1)
    ]
    axes = "" if held else "z"
    bodies.append(_body("heavy", p.heavy_mass, site=f"site{beads + 1}", place=heavy_mass_position, axes=axes))
    links = range(beads + 1) if has_string else ()
    # autoreset is off: after a breakdown MuJoCo would go on from the first state, with a mere warning
    return f"""
<mujoco model="looping pendulum, beads">
  <compiler angle="degree" inertiafromgeom="false"/>
  <option timestep="{s.time_step!r}" integrator="{s.integrator}" cone="{s.cone}" impratio="{s.friction_to_normal_impedance!r}"
          solver="{s.solver}" iterations="{s.solver_iterations}" tolerance="{s.solver_tolerance!r}" jacobian="{s.jacobian}"
          gravity="0 0 {-p.coefficients["gravity"]!r}">
    <flag autoreset="disable"/>
  </option>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="rod" type="cylinder" size="{s.node_radius(p.rod_radius) - s.bead_radius!r} 0.05" euler="90 0 0"/>
    {"".join(bodies)}
  </worldbody>
  <tendon>{"".join(_link(p, s, i, straight=i in (0, beads)) for i in links)}</tendon>
  <equality>{"".join(_link_constraint(s, i) for i in links if i not in (0, beads))}</equality>
  <contact>{"".join(_pair(p, s, i) for i in range(1, beads + 1))}</contact>
</mujoco>"""


def _body(
    name: str, mass: float, *, site: str, geom: str = "", place: tuple[float, float] = (0.0, 0.0), axes: str = "xz"
) -> str:
    """Return one mass on slide joints along ``axes``, with the site at which its tendons end."""
    joints = "".join(f'<joint type="slide" axis="{"1 0 0" if axis == "x" else "0 0 1"}"/>' for axis in axes)
    # MuJoCo requires moments of inertia; on slides they have no influence
    inertia = f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-6 1e-6 1e-6"/>'
    x, y = place
    return f'<body name="{name}" pos="{x!r} 0 {y!r}">{joints}{inertia}{geom}<site name="{site}"/></body>\n'


def _sphere(i: int, radius: float) -> str:
    """Return the geometry of bead ``i``."""
    return f'<geom name="sphere{i}" type="sphere" size="{radius!r}"/>'


def _link(parameters: Parameters, s: BeadSettings, i: int, *, straight: bool) -> str:
    """Return tendon ``i`` of the row; a straight part has an upper limit of its length."""
    stiffness = f'solreflimit="{s.string_time_constant!r} 1" solimplimit="{s.string_impedance!r} {s.string_impedance!r} 0.001"'
    limit = f'limited="{"true" if straight else "false"}" range="0 {parameters.string_length!r}" {stiffness}'
    return f'<spatial name="link{i}" {limit}><site site="site{i}"/><site site="site{i + 1}"/></spatial>\n'


def _link_constraint(s: BeadSettings, i: int) -> str:
    """Return the equality constraint that keeps the length of link ``i`` between two beads."""
    solver = f'solref="{s.string_time_constant!r} 1" solimp="{s.string_impedance!r} {s.string_impedance!r} 0.001"'
    return f'<tendon tendon1="link{i}" {solver}/>'


def _pair(parameters: Parameters, s: BeadSettings, i: int) -> str:
    """Return the contact of bead ``i`` with the rod, with the scenario's friction coefficient."""
    friction = s.contact_friction(parameters.coefficients["kinetic_friction"])
    solver = (
        f'solref="{s.contact_time_constant!r} 1" solimp="{s.least_contact_impedance!r} {s.contact_impedance!r} 0.0005"'
        f' friction="{friction!r} {friction!r} 0 0 0"'
    )
    return f'<pair geom1="rod" geom2="sphere{i}" condim="3" {solver}/>'


SLACK_FRACTION = 1e-3
"""A straight part shorter than its string by more than this fraction is slack; then no bead is added or removed there."""

Row = Sequence[float] | Array
"""Values of all degrees of freedom."""


class _CompiledModel:
    """A compiled model with its data, and the arrays of both that the rig reads and writes.

    The arrays are stored, because fetching one from MuJoCo's objects costs as much as the arithmetic on it.
    """

    def __init__(self, mujoco: Any, xml: str) -> None:
        self.model: Any = compile_model(mujoco, xml)
        self.data: Any = mujoco.MjData(self.model)
        self.qpos, self.qvel, self.applied = self.data.qpos, self.data.qvel, self.data.qfrc_applied
        self.warm_start = self.data.qacc_warmstart
        self.max_straight_lengths = self.model.tendon_range[:, 1]
        """Upper limit of each tendon's length [m]; the rig uses those of the two straight parts."""
        self.link_length_offsets = self.model.eq_data[:, 0]
        """Lengths that the equality constraints keep between beads, less `natural_lengths` [m]."""
        self.natural_lengths = self.model.tendon_length0.copy()
        self.breakdown_warnings = breakdown_warnings(mujoco, self.data)


class BeadRig:
    """The apparatus in MuJoCo, with one model for every number of beads, compiled when it is first needed."""

    def __init__(self, parameters: Parameters, settings: BeadSettings) -> None:
        import mujoco

        p = parameters
        self._mujoco: Any = mujoco
        self._step: Any = mujoco.mj_step
        self._parameters, self._settings = p, settings
        self._node_radius = settings.node_radius(p.rod_radius)
        self._bead_rule = BeadCountRule(p.rod_radius, settings.bend, self._node_radius)
        self._link_length = self._bead_rule.link_length
        softness = settings.string_impedance * settings.string_time_constant
        self._turning_shift = (
            softness * softness
        )  # compensates for l omega^2, which MuJoCo leaves out of a tendon's acceleration
        self._has_string, self._held = p.release is not Release.DROP, p.release is Release.HELD
        self._heavy_dofs = 0 if self._held else 1
        self._force = cartesian_force(p)
        self._compiled: dict[int, _CompiledModel] = {}
        self._slip = SlipGauge()
        self._place_chain()

    def advance(self) -> None:
        """Step through one sample interval, in groups of steps."""
        for _ in range(self._settings.groups_per_sample):
            places = self._current.qpos.tolist()
            self._prepare(self._update_beads(places) if self._has_string else places)
            # One call for the whole group, which spares Python between its steps
            self._step(self._current.model, self._current.data, self._settings.steps_per_group)

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        if any(warning.number for warning in self._current.breakdown_warnings):
            return (math.nan,) * 10
        x, y = self._current.qpos[:2].tolist()
        vx, vy = self._current.qvel[:2].tolist()
        heavy_y, heavy_v = self._heavy_mass_state()
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, *self._stretch_and_slip())

    def _place_chain(self) -> None:
        """Place the chain along the taut string, with the release's velocities."""
        p, bend = self._parameters, self._settings.bend
        vx, vy, heavy_v = release_velocity(p)
        # The outermost bead stands at most half a link before or behind the tangent point.
        count = max(round(p.release_angle / bend) + 1, MIN_BEADS) if self._has_string else 0
        first = p.release_angle - 0.5 * (p.release_angle - (count - 1) * bend)
        angles = [first - i * bend for i in range(count)]
        light = point_on_string(p, 0.0, p.rod_radius)
        beads = [(self._node_radius * math.cos(a), self._node_radius * math.sin(a)) for a in angles]
        rows = [light, *beads, (p.rod_radius, -p.hanging_length)]
        self.lengths = [math.dist(a, b) for a, b in zip(rows[:-1], rows[1:], strict=True)]
        sliding = [(-heavy_v * math.sin(a), heavy_v * math.cos(a)) for a in angles]
        # Cut off: a heavy mass that is held has no coordinate
        places = np.array([*light, *np.ravel(beads), -p.hanging_length][: 2 * count + 2 + self._heavy_dofs])
        speeds = np.array([vx, vy, *np.ravel(sliding), heavy_v][: 2 * count + 2 + self._heavy_dofs])
        self._switch_model(count, 0.0, places, speeds, np.zeros_like(places))

    def _switch_model(self, beads: int, time: float, qpos: Row, qvel: Row, warm_start: Row) -> None:
        """Continue with the model of ``beads`` beads, from the given state."""
        if beads not in self._compiled:
            self._compiled[beads] = _CompiledModel(self._mujoco, bead_xml(self._parameters, self._settings, beads))
        self._beads, self._current = beads, self._compiled[beads]
        current = self._current
        current.data.time = time
        current.qpos[:], current.qvel[:], current.warm_start[:] = qpos, qvel, warm_start
        if self._has_string:
            current.max_straight_lengths[0], current.max_straight_lengths[beads] = self.lengths[0], self.lengths[beads]
            current.link_length_offsets[:] = self.lengths[1:beads]
            current.link_length_offsets -= current.natural_lengths[1:beads]

    def _heavy_mass_state(self) -> tuple[float, float]:
        """Return height [m] and upward velocity [m/s] of the heavy mass."""
        if self._held:
            return -self._parameters.hanging_length, 0.0
        return float(self._current.qpos[-1]), float(self._current.qvel[-1])

    def _prepare(self, places: list[float]) -> None:
        """Set the applied forces and the limit of the light mass's straight part for the coming group of steps."""
        current = self._current
        speeds = current.qvel.tolist()
        x, y, vx, vy = places[0], places[1], speeds[0], speeds[1]
        if self._force is not None:
            heavy_v = 0.0 if self._held else speeds[-1]
            current.applied[0], current.applied[1], heavy = self._force(current.data.time, x, y, vx, vy, heavy_v)
            if not self._held:
                current.applied[-1] = heavy
        if self._has_string:
            x, y = x - places[2], y - places[3]
            square = max(x * x + y * y, 1e-16)  # avoids a division by zero if mass and bead coincide
            across = x * vy - y * vx  # without the bead's velocity, which is sliding along the string
            turning = across * across / (square * math.sqrt(square))
            current.max_straight_lengths[0] = self.lengths[0] - self._turning_shift * turning

    def _update_beads(self, places: list[float]) -> list[float]:
        """Add or remove a bead on either straight part, if needed; take and return the coordinates ``places`` of all bodies."""
        if self._update_end(0, places[:2], places[2:4], places[4:6]):
            places = self._current.qpos.tolist()
        last = 2 * self._beads
        heavy = (self._parameters.rod_radius, -self._parameters.hanging_length if self._held else places[-1])
        if self._update_end(self._beads, heavy, places[last : last + 2], places[last - 2 : last]):
            places = self._current.qpos.tolist()
        return places

    def _update_end(self, link: int, mass: Point, end: Point, following: Point) -> bool:
        """Add or remove a bead, if needed, between ``mass`` and the outermost bead ``end``, which straight ``link`` connects.

        Return whether the number of beads has changed.
        """
        distance = math.dist(mass, end)
        if distance < (1 - SLACK_FRACTION) * self.lengths[link]:
            return False
        change = self._bead_rule.bead_count_change(mass, end, following, self.lengths[link], self._beads)
        if change > 0:
            self._add_bead(link, self._link_length / distance)
        elif change < 0:
            self._remove_bead(link)
        return change != 0

    def _add_bead(self, link: int, fraction: float) -> None:
        """Put a bead on the straight ``link``, at this ``fraction`` of the way from the outermost bead to the mass."""
        count = self._beads
        heavy_y, heavy_v = self._heavy_mass_state()
        at, bead = (2, 2) if link == 0 else (2 * count + 2, 2 * count)

        def with_bead(row: list[float], heavy: tuple[float, float]) -> list[float]:
            # Position, velocity and acceleration of the new bead are all interpolated, so that the motion stays smooth.
            mass_x, mass_y = row[:2] if link == 0 else heavy
            x, y = row[bead : bead + 2]
            return [*row[:at], x + fraction * (mass_x - x), y + fraction * (mass_y - y), *row[at:]]

        rest = self.lengths[link] - self._link_length
        self.lengths[link : link + 1] = [rest, self._link_length] if link == 0 else [self._link_length, rest]
        places, speeds, accelerations = self._state_rows()
        self._switch_model(
            count + 1,
            self._current.data.time,
            with_bead(places, (self._parameters.rod_radius, heavy_y)),
            with_bead(speeds, (0.0, heavy_v)),
            with_bead(accelerations, (0.0, 0.0)),
        )

    def _remove_bead(self, link: int) -> None:
        """Remove the outermost bead, so that the straight ``link`` gets longer."""
        count = self._beads
        first = 2 if link == 0 else 2 * count
        joined = slice(0, 2) if link == 0 else slice(count - 1, count + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        places, speeds, accelerations = (row[:first] + row[first + 2 :] for row in self._state_rows())
        self._switch_model(count - 1, self._current.data.time, places, speeds, accelerations)

    def _state_rows(self) -> tuple[list[float], list[float], list[float]]:
        """Return coordinates, velocities, and the accelerations from which MuJoCo's solver starts."""
        return self._current.qpos.tolist(), self._current.qvel.tolist(), self._current.warm_start.tolist()

    def _stretch_and_slip(self) -> tuple[float, float]:
        """Return how much longer than its rest length the string is (negative: it is slack), and how far it has slid [m]."""
        if not self._has_string:
            return math.nan, math.nan
        places = self._current.qpos[: 2 * self._beads + 2].reshape(-1, 2).tolist()
        places.append((self._parameters.rod_radius, self._heavy_mass_state()[0]))
        stretch = math.fsum(map(math.dist, places[:-1], places[1:])) - math.fsum(self.lengths)
        return stretch, self._slip.read(places, self.lengths)


class MujocoBeads(TunedEngine):
    """MuJoCo with the string as a chain of beads over a cylinder."""

    name = "mujoco"
    distribution = "mujoco"
    variant = "beads"
    settings_by_profile = SETTINGS
    settings: BeadSettings
    abilities = bead_abilities(
        "mujoco:beads",
        quick_cost=4.0,
        rod="cylinder",
        stick_slip="the solver keeps friction within its elliptic cone",
        packages=("mujoco",),
        summary="Beads on links of fixed length over a cylinder, a limited tendon for each straight part of the string.",
        limits=(
            ONE_COEFFICIENT,
            "friction that is a soft constraint creeps: the halted heavy mass still sinks, by some 0.03 mm/s",
            STRAIGHT_STRING,
            NO_STOP,
        ),
        bead_mass_ratio=SETTINGS[Profile.QUICK].bead_mass_ratio,
    )

    def build(self, scenario: Scenario) -> BeadRig:
        """Rebuild the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return the studies: step, softness, links and their mass; MuJoCo's defaults; the polygon and the updates of beads."""
        s = self.settings
        group_time = s.time_step * s.steps_per_group
        steps = [{"time_step": dt, "steps_per_group": round(group_time / dt)} for dt in (2e-5, 1e-5, 5e-6, 2.5e-6, 1.25e-6)]
        return studies_from_rows(
            self,
            ladders=(
                ("time_step", "s", steps, "steps between two updates of drag and beads, so that the time between them stays"),
                bend_rungs(s, (0.4, 0.32, 0.28, 0.24, 0.2)),
                ("bead_mass_ratio", "", (8e-4, 4e-4, 2e-4, 1e-4, 5e-5)),
                softness_rungs("contact_time_constant", s.time_step),
                softness_rungs("string_time_constant", s.time_step),
            ),
            defaults=(
                time_constant_default(s, "string_time_constant", "solref (links)", "how fast links return to their length"),
                time_constant_default(s, "contact_time_constant", "solref (contacts)", "how fast beads come to rest"),
                (
                    "solimp (links)",
                    "0.95",
                    f"{s.string_impedance:g}",
                    "how much of a link is enforced",
                    {"string_impedance": 0.95},
                ),
                (
                    "solimp (contacts)",
                    "0.9 to 0.95",
                    f"{s.least_contact_impedance:g} to {s.contact_impedance:g} within 0.5 mm",
                    "how much of a contact is enforced",
                    {"least_contact_impedance": 0.9, "contact_impedance": 0.95},
                ),
                ("cone", "pyramidal", s.cone, "shape of the friction cone", {"cone": "pyramidal"}),
                (
                    "impratio",
                    "1",
                    f"{s.friction_to_normal_impedance:g}",
                    "how much harder friction is than contact",
                    {"friction_to_normal_impedance": 1.0},
                ),
                *solver_defaults(s, steps_per_group=1),
            ),
            choices=(
                ("radius and coefficient", "corrected for the polygon", "the circle's own", {"polygon": False}),
                ("steps between two updates of drag and beads", f"{s.steps_per_group}", "1", {"steps_per_group": 1}),
                ("bead radius", quantity(s.bead_radius, "m", 3), "0.5 mm", {"bead_radius": 5e-4}),
            ),
        )

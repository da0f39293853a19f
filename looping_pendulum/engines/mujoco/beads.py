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

from looping_pendulum.engines.bead_rig import Forces, RebuiltRig
from looping_pendulum.engines.chain import (
    NO_STOP,
    ONE_COEFFICIENT,
    STRAIGHT_STRING,
    BeadChainSettings,
    bead_abilities,
    bead_choices,
    bend_rungs,
)
from looping_pendulum.engines.mujoco.model import (
    breakdown_warnings,
    compile_model,
    softness_rungs,
    solver_defaults,
    time_constant_default,
)
from looping_pendulum.engines.protocol import Profile, SteppedEngine
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.reference_ode.parameters import Parameters, Release


@dataclass(frozen=True, kw_only=True)
class BeadSettings(BeadChainSettings):
    """Numerical settings of the bead chain. Lighter beads need shorter steps."""

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
    steps_per_group: int = 20


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
    for i in range(1, beads + 1):
        sphere = f'<geom name="sphere{i}" type="sphere" size="{s.bead_radius!r}"/>'
        bodies.append(_body(f"bead{i}", s.bead_mass_ratio * p.light_mass, site=f"site{i}", geom=sphere))
    axes = "" if held else "z"
    bodies.append(_body("heavy", p.heavy_mass, site=f"site{beads + 1}", place=heavy_mass_position, axes=axes))
    links = range(beads + 1) if has_string else ()
    time_constant, impedance = f"{s.string_time_constant!r} 1", f"{s.string_impedance!r} {s.string_impedance!r} 0.001"
    # A straight part has an upper limit of its length
    tendons = [
        f'<spatial name="link{i}" limited="{"true" if i in (0, beads) else "false"}" range="0 {p.string_length!r}"'
        f' solreflimit="{time_constant}" solimplimit="{impedance}"><site site="site{i}"/><site site="site{i + 1}"/></spatial>'
        for i in links
    ]
    constraints = [
        f'<tendon tendon1="link{i}" solref="{time_constant}" solimp="{impedance}"/>' for i in links if i not in (0, beads)
    ]
    friction = s.contact_friction(p.coefficients["kinetic_friction"])
    contact = (
        f'condim="3" solref="{s.contact_time_constant!r} 1"'
        f' solimp="{s.least_contact_impedance!r} {s.contact_impedance!r} 0.0005" friction="{friction!r} {friction!r} 0 0 0"'
    )
    pairs = [f'<pair geom1="rod" geom2="sphere{i}" {contact}/>' for i in range(1, beads + 1)]
    # autoreset is off: after a breakdown MuJoCo would go on from the first state, with a mere warning. All bodies are joined to
    # one island, which MuJoCo need not look for at every step
    return f"""
<mujoco model="looping pendulum, beads">
  <compiler angle="degree" inertiafromgeom="false"/>
  <option timestep="{s.time_step!r}" integrator="{s.integrator}" cone="{s.cone}" impratio="{s.friction_to_normal_impedance!r}"
          solver="{s.solver}" iterations="{s.solver_iterations}" tolerance="{s.solver_tolerance!r}" jacobian="{s.jacobian}"
          gravity="0 0 {-p.coefficients["gravity"]!r}">
    <flag autoreset="disable" island="disable"/>
  </option>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="rod" type="cylinder" size="{s.node_radius(p.rod_radius) - s.bead_radius!r} 0.05" euler="90 0 0"/>
    {"".join(bodies)}
  </worldbody>
  <tendon>{"".join(tendons)}</tendon>
  <equality>{"".join(constraints)}</equality>
  <contact>{"".join(pairs)}</contact>
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


class MujocoBeadRig(RebuiltRig):
    """The apparatus in MuJoCo, with one compiled model for every number of beads."""

    _model: _CompiledModel

    def _create_world(self) -> None:
        import mujoco

        self._mujoco: Any = mujoco
        softness = self._settings.string_impedance * self._settings.string_time_constant
        # Compensates for l omega^2, which MuJoCo leaves out of a tendon's acceleration
        self._turning_shift = softness * softness

    def _build_model(self, beads: int) -> _CompiledModel:
        return _CompiledModel(self._mujoco, bead_xml(self._parameters, self._settings, beads))

    def _start_model(self) -> None:
        current = self._model
        current.qpos[:], current.qvel[:], current.warm_start[:] = map(self._flat, self._rows)
        if self._has_string:
            current.max_straight_lengths[0], current.max_straight_lengths[len(self._lengths) - 1] = (
                self._lengths[0],
                self._lengths[-1],
            )
            current.link_length_offsets[:] = self._lengths[1:-1]
            current.link_length_offsets -= current.natural_lengths[1:-1]

    def _coordinates(self) -> Sequence[list[float]]:
        current = self._model
        rows = current.qpos.tolist(), current.qvel.tolist(), current.warm_start.tolist()
        if any(warning.number for warning in current.breakdown_warnings):
            return [[math.nan] * len(row) for row in rows]
        return rows

    def _advance_model(self, count: int, forces: Forces | None) -> None:
        """Take ``count`` steps, with the forces and the limit of the light mass's straight part set before them."""
        current = self._model
        if forces is not None:
            (current.applied[0], current.applied[1]), heavy = forces
            if not self._is_held:
                current.applied[-1] = heavy
        if self._has_string:
            (x, y), (bead_x, bead_y), (vx, vy) = self._position(0), self._position(1), self._velocity(0)
            x, y = x - bead_x, y - bead_y
            square = max(x * x + y * y, 1e-16)  # avoids a division by zero if mass and bead coincide
            across = x * vy - y * vx  # without the bead's velocity, which is sliding along the string
            turning = across * across / (square * math.sqrt(square))
            current.max_straight_lengths[0] = self._lengths[0] - self._turning_shift * turning
        # One call for all steps, which spares Python between them
        self._mujoco.mj_step(current.model, current.data, count)


class MujocoBeads(SteppedEngine):
    """MuJoCo with the string as a chain of beads over a cylinder."""

    name = "mujoco"
    distribution = "mujoco"
    variant = "beads"
    settings_by_profile = SETTINGS
    rig = MujocoBeadRig
    settings: BeadSettings
    abilities = bead_abilities(
        "mujoco:beads",
        rod="cylinder",
        stick_slip="the solver keeps friction within its elliptic cone",
        summary="Beads on links of fixed length over a cylinder, a limited tendon for each straight part of the string.",
        limits=(
            ONE_COEFFICIENT,
            "friction that is a soft constraint creeps: the halted heavy mass still sinks, by some 0.03 mm/s",
            STRAIGHT_STRING,
            NO_STOP,
        ),
        bead_mass_ratio=SETTINGS[Profile.QUICK].bead_mass_ratio,
    )

    def studies(self) -> Studies:
        """Return the studies: step, softness, links and their mass; MuJoCo's defaults; the polygon and the updates of beads."""
        s = self.settings
        group_time = s.time_step * s.steps_per_group
        steps = [{"time_step": dt, "steps_per_group": round(group_time / dt)} for dt in (2e-5, 1e-5, 5e-6, 2.5e-6, 1.25e-6)]
        return Studies(
            ladders=(
                Ladder("time_step", "s", steps, "steps per update of drag and beads, so that its interval stays"),
                bend_rungs(s, (0.4, 0.32, 0.28, 0.24, 0.2)),
                Ladder("bead_mass_ratio", "", (8e-4, 4e-4, 2e-4, 1e-4, 5e-5)),
                softness_rungs("contact_time_constant", s.time_step),
                softness_rungs("string_time_constant", s.time_step),
            ),
            defaults=(
                time_constant_default(s, "string_time_constant", "solref (links)", "how fast links return to their length"),
                time_constant_default(s, "contact_time_constant", "solref (contacts)", "how fast beads come to rest"),
                default_row(s, "string_impedance", 0.95, "solimp (links)", "how much of a link is enforced"),
                Variation(
                    "solimp (contacts)",
                    f"{s.least_contact_impedance:g} to {s.contact_impedance:g} within 0.5 mm",
                    "0.9 to 0.95",
                    {"least_contact_impedance": 0.9, "contact_impedance": 0.95},
                    "how much of a contact is enforced",
                ),
                default_row(s, "cone", "pyramidal", "cone", "shape of the friction cone"),
                default_row(s, "friction_to_normal_impedance", 1.0, "impratio", "how much harder friction is than contact"),
                *solver_defaults(s, steps_per_group=1),
            ),
            choices=bead_choices(s),
        )

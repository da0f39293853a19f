"""The apparatus as a MuJoCo model: two masses and a chain of beads where the string touches the rod."""

from __future__ import annotations

from dataclasses import dataclass

from looping_pendulum.engines.chain import polygon_friction, polygon_radius
from looping_pendulum.engines.protocol import Profile, groups_per_sample
from looping_pendulum.reference_ode.parameters import Parameters, Release


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

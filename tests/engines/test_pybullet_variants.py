"""PyBullet's variants for studies: the chain made anew, that in maximal coordinates, the defaults; and all declared studies."""

import math

import numpy as np
import pytest

from looping_pendulum.engines.chain import MIN_BEADS
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pybullet.chain import PybulletChain, PybulletDefaults
from looping_pendulum.engines.pybullet.point_to_point import PybulletPointToPoint
from looping_pendulum.engines.pybullet.remade import SETTINGS, NodeChanges, PybulletRemade, RemadeRig, nodes_at_release
from looping_pendulum.engines.pybullet.world import ChainState
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

pytest.importorskip("pybullet")

QUICK = SETTINGS[Profile.QUICK]


def scenario(duration: float, **changes: object) -> Scenario:
    return Scenario(name="test", title="", description="", parameters=TEN_TO_ONE.replace(**changes), duration=duration)


def farthest(engine, case: Scenario) -> float:
    """Return the largest distance of the light mass from the reference's [m]."""
    run = engine.simulate(case).raise_if_failed()
    exact = solve_at(case.parameters, run.t, duration=case.duration)
    return float(np.linalg.norm(run.light_position[: len(exact.t)] - exact.light_position, axis=1).max())


@pytest.mark.accurate  # a variant for studies, which no daily check runs
def test_pinned_bodies_follow_the_reference_as_near_as_their_string_keeps_its_length() -> None:
    case = scenario(0.06, rod_radius=0.03, free_length=0.25)
    coarse = PybulletPointToPoint()
    fine = coarse.with_settings(time_step=coarse.settings.time_step / 2.5)
    stretches = [np.abs(engine.simulate(case).string_stretch).max() for engine in (coarse, fine)]
    assert stretches[1] < 0.5 * stretches[0]  # the pins' give falls with the step, faster than in proportion
    assert farthest(fine, case) < 2 * stretches[1] + 2 * fine.settings.link_length**2 / (8 * 0.03)


def pushed_chain() -> tuple[Parameters, ChainState]:
    """A chain whose masses, nodes and links all move as one taut string."""
    p = scenario(0.1, free_length=0.4, push_along=0.4, push_across=0.7).parameters
    return p, nodes_at_release(p, QUICK, release_velocity(p))


def test_remade_pushed_chain_turns_about_its_tangent_point_and_slides_as_the_reference_does() -> None:
    p, chain = pushed_chain()
    light, heavy = chain.velocities[-1], chain.velocities[0]
    assert light == pytest.approx(release_velocity(p)[:2])
    assert heavy == pytest.approx((0.0, release_velocity(p)[2]))
    # Rigid links: neighbours have one speed along the link between them, but for corners cut by half a bend.
    along = np.diff(chain.positions, axis=0) / chain.lengths[:, None]
    mismatch = (np.diff(chain.velocities, axis=0) * along).sum(axis=1)
    half_bend = 0.5 * QUICK.length_on_rod(p) / p.rod_radius
    assert np.abs(mismatch).max() <= abs(heavy[1]) * (1 - math.cos(half_bend)) + 1e-12
    assert abs(heavy[1]) > 0.01


def test_a_node_comes_before_the_string_touches_the_rod_and_goes_after_it_has_left() -> None:
    p, s = scenario(0.1, free_length=0.4).parameters, QUICK
    node_changes, circle = NodeChanges(p, s), s.node_circle(p)
    bend = s.length_on_rod(p) / p.rod_radius
    lift = s.length_on_rod(p) ** 2 / p.rod_radius

    def chain(turn: float, nodes: int = 5) -> ChainState:
        """Nodes on the rod, and straight string that leaves the last one ``turn`` [rad] outside the chord to the next place."""
        angles = bend * np.arange(nodes)
        on_rod = circle * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        direction = angles[-1] + 0.5 * bend + 0.5 * math.pi - turn
        light = on_rod[-1] + 0.4 * np.array([math.cos(direction), math.sin(direction)])
        heavy = on_rod[0] + 0.2 * np.array([math.sin(-0.5 * bend + turn), -math.cos(-0.5 * bend + turn)])
        positions = np.vstack([heavy, on_rod, light])
        return ChainState(positions=positions, velocities=np.zeros_like(positions))

    about = bend * p.rod_radius / circle  # turn by which a place a link away rises by `lift`
    near, far = chain(0.5 * s.comes * lift / s.length_on_rod(p)), chain(2 * s.comes * about)
    assert min(node_changes.margins(near.positions, 5)) < 0 < min(node_changes.margins(far.positions, 5))
    longer = node_changes.with_updated_nodes(near)
    assert len(longer.positions) == len(near.positions) + 2  # one on either side
    assert longer.lengths.sum() == pytest.approx(near.lengths.sum(), rel=1e-12)
    gone = chain(bend + 2 * s.goes * about)  # straight through the outermost nodes, and beyond
    assert min(node_changes.margins(gone.positions, 5)) < 0
    shorter = node_changes.with_updated_nodes(gone)
    assert len(shorter.positions) == len(gone.positions) - 2
    assert shorter.lengths.sum() == pytest.approx(gone.lengths.sum(), rel=1e-5)
    few = chain(bend + 2 * s.goes * about, nodes=MIN_BEADS)
    assert len(node_changes.with_updated_nodes(few).positions) == MIN_BEADS + 2


def test_nodes_that_go_keep_the_strings_length_and_momentum() -> None:
    p, chain = pushed_chain()
    s = QUICK
    positions, velocities = chain.positions.copy(), chain.velocities.copy()
    extra = positions[0] + np.array([2e-5, 0.6 * p.hanging_length])  # a node that swings on the straight part below the rod
    swinging = ChainState(
        positions=np.insert(positions, 1, extra, axis=0),
        velocities=np.insert(velocities, 1, velocities[0] + [0.8, 0.0], axis=0),
    )
    after = NodeChanges(p, s).with_updated_nodes(swinging)
    assert len(after.positions) == len(chain.positions)
    assert after.lengths.sum() == pytest.approx(swinging.lengths.sum(), abs=1e-9)
    along = (positions[-1] - positions[-2]) / math.dist(positions[-1], positions[-2])
    moved_light = float((after.positions[-1] - positions[-1]) @ along)
    moved_heavy = positions[0, 1] - after.positions[0, 1]
    assert p.light_mass * moved_light == pytest.approx(p.heavy_mass * moved_heavy, rel=1e-6)


def test_making_the_multibody_anew_holds_the_state() -> None:
    rig = RemadeRig(scenario(0.1, free_length=0.4).parameters, QUICK)
    for _ in range(30):
        rig.advance()
    before, row = rig._chain(), rig.read()
    rig._world.api.removeBody(rig._body, physicsClientId=rig._world.client)
    rig._create_multibody(before)
    after = rig._chain()
    assert after.positions == pytest.approx(before.positions, abs=1e-12)
    # A link carries no speed along itself: what Bullet's step left there, second order in the step, goes.
    assert after.velocities == pytest.approx(before.velocities, abs=1e-6)
    assert rig.read() == pytest.approx(row, abs=1e-6)
    assert rig.rebuild_count > 1


def test_links_too_long_for_the_rod_are_refused() -> None:
    with pytest.raises(EngineError, match="cannot wrap a rod of radius 1 mm; shorten link_length to 1.3 mm"):
        QUICK.length_on_rod(scenario(0.1, rod_radius=1e-3).parameters)


def test_remade_chain_follows_the_reference_while_the_string_slides() -> None:
    """A ripple of h^2 / 8R at each end of the wound string, twice over."""
    engine = PybulletRemade()
    assert farthest(engine, scenario(0.15)) <= 4 * engine.settings.link_length**2 / (8 * TEN_TO_ONE.rod_radius)


@pytest.mark.xfail(strict=True, reason="joint motors, on by default, hold every hinge: the string is a stiff wire")
def test_defaults_follow_the_reference() -> None:
    assert farthest(PybulletDefaults(), scenario(0.15)) < 5e-3


def test_every_time_step_of_a_ladder_divides_the_sample_interval() -> None:
    for engine in (PybulletChain(), PybulletRemade(), PybulletPointToPoint()):
        steps = engine.studies().ladders[0].values
        assert all(math.isclose(round(1e-3 / dt) * dt, 1e-3) for dt in steps)
        assert list(steps) == sorted(steps, reverse=True)


def test_friction_that_is_given_together_with_damping_is_ignored() -> None:
    """The trap itself: PyBullet keeps its default of 0.5 for the link."""
    import pybullet

    case = scenario(0.01)
    frictions = []
    for together in (False, True):
        rig = PybulletChain().with_settings(friction_with_damping=together).build(case)
        frictions.append(pybullet.getDynamicsInfo(rig._body, 2, physicsClientId=rig._world.client)[1])
    assert frictions[0] < 0.45
    assert frictions[1] == 0.5

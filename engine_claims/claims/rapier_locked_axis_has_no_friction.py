"""Rapier: a body with one translation axis locked, as for motion in a plane, slides without friction.

A ball that cannot turn slides along x over a floor, with the axis z locked. Friction is solved for two directions at once, and
the locked one spoils the other: in a chain over a rod a third of the friction is lost, here all of it. Keep z free, where
nothing pushes that way.

Closed form: 0.08528 m = v t - mu g t^2 / 2, way of a mass that friction brakes
Observed: 0.10000 m with rapier3d 0.36.1, give or take 1e-4
Mended: within 1e-3 m of the closed form
"""

from importlib.metadata import version

import rapier3d

MU, GRAVITY, SPEED, TIME, STEP, RADIUS = 0.3, 9.81, 1.0, 0.1, 1e-3, 0.05
LIMIT = 1e-3
closed_form = SPEED * TIME - MU * GRAVITY * TIME**2 / 2

world = rapier3d.PhysicsWorld(gravity=(0, -GRAVITY, 0))
world.integration_parameters.dt = STEP
floor = rapier3d.Collider.cuboid(10, 1, 10).translation((0, -1, 0)).friction(MU)
world.add_body(rapier3d.RigidBody.fixed(), [floor])
slider = rapier3d.RigidBody.dynamic().translation((0, RADIUS, 0)).linvel((SPEED, 0, 0)).enabled_rotations((False, False, False))
slider = slider.enabled_translations((True, True, False))
handle = world.add_body(slider, [rapier3d.Collider.ball(RADIUS).friction(MU)])
for _ in range(round(TIME / STEP)):
    world.step()
observed = world.rigid_bodies[handle].translation.x

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with rapier3d {version('rapier3d')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))

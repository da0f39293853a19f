"""Rapier: by default a body rests a little inside a fixed one, g / (2 pi 60 Hz)^2 deep under its own weight alone.

A ball of 0.1 m radius lies on a floor. Contacts with fixed bodies are springs of 60 Hz (static_contact_softness).

Closed form: 100.00000 mm = r, height of the centre of a ball that lies on the floor
Observed: 99.93100 mm with rapier3d 0.36.1, give or take 1e-3
Mended: within 0.01 mm of the closed form
Default: static_contact_softness
"""

from importlib.metadata import version

import rapier3d

RADIUS = 0.1
LIMIT = 0.01
closed_form = 1e3 * RADIUS

world = rapier3d.PhysicsWorld(gravity=(0, -9.81, 0))
world.add_body(rapier3d.RigidBody.fixed(), [rapier3d.Collider.cuboid(5, 1, 5).translation((0, -1, 0))])
handle = world.add_body(rapier3d.RigidBody.dynamic().translation((0, RADIUS, 0)), [rapier3d.Collider.ball(RADIUS)])
for _ in range(120):
    world.step()
observed = 1e3 * world.rigid_bodies[handle].translation.y

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with rapier3d {version('rapier3d')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))

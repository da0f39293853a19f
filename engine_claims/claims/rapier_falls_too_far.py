"""Rapier: with the default step a body falls too far, by half a sub-step times its speed.

A mass falls from rest for 0.5 s, in steps of 1/60 s of four sub-steps. It moves with the speed of each sub-step's end; so a run
is ahead by half a sub-step, however long it is.

Closed form: 1226.25000 mm = g t^2 / 2, height of fall
Observed: 1236.46820 mm with rapier3d 0.36.1, give or take 1e-2
Mended: within 1 mm of the closed form
Default: dt, num_solver_iterations
"""

from importlib.metadata import version

import rapier3d

GRAVITY, TIME = 9.81, 0.5
LIMIT = 1
closed_form = 1e3 * GRAVITY * TIME**2 / 2

world = rapier3d.PhysicsWorld(gravity=(0, -GRAVITY, 0))
handle = world.add_body(rapier3d.RigidBody.dynamic().additional_mass(1))
for _ in range(round(TIME * 60)):
    world.step()
observed = -1e3 * world.rigid_bodies[handle].translation.y

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} mm, mended within {LIMIT} mm")
print(f"observed {observed:.5f} mm with rapier3d {version('rapier3d')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))

"""Rapier: by default a body slower than 0.05 m/s is stopped after half a second.

A ball moves freely at 0.04 m/s, without gravity. It falls asleep; can_sleep(False) keeps it awake.

Closed form: 0.08000 m = v t, way in 2 s
Observed: 0.01933 m with rapier3d 0.36.1, give or take 1e-3
Mended: within 1e-3 m of the closed form
Default: can_sleep
"""

from importlib.metadata import version

import rapier3d

SPEED, TIME = 0.04, 2
LIMIT = 1e-3
closed_form = SPEED * TIME

world = rapier3d.PhysicsWorld()
body = rapier3d.RigidBody.dynamic().linvel((SPEED, 0, 0))
handle = world.add_body(body, [rapier3d.Collider.ball(0.1)])
for _ in range(round(TIME * 60)):
    world.step()
observed = world.rigid_bodies[handle].translation.x

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with rapier3d {version('rapier3d')}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))

"""pymunk: a pin joint lengthens as its mass goes round, since the default error_bias takes an error back slowly.

A mass goes round a fixed point without gravity on a pin of 0.5 m at 20 rad/s. Each step along the tangent adds
l (omega dt)^2 / 2 to the length, of which the default error_bias takes back a tenth in 1/60 s.

Closed form: 0.50000 m, length of the pin, which must stay
Observed: 0.51456 m with pymunk 7.3.1, give or take 1e-4
Mended: within 0.002 m of the closed form
Default: error_bias, dt
"""

import math

import pymunk

LENGTH, ANGULAR_SPEED, STEP = 0.5, 20.0, 1e-3
LIMIT = 2e-3
closed_form = LENGTH

space = pymunk.Space()
mass = pymunk.Body(0.01, math.inf)
mass.position = LENGTH, 0
mass.velocity = 0, LENGTH * ANGULAR_SPEED
space.add(mass, pymunk.PinJoint(space.static_body, mass))
for _ in range(2000):
    space.step(STEP)
observed = mass.position.length

holds = not abs(observed - closed_form) <= LIMIT
print(f"closed form {closed_form:.5f} m, mended within {LIMIT} m")
print(f"observed {observed:.5f} m with pymunk {pymunk.version}: the claim {'holds' if holds else 'is mended'}")
raise SystemExit(int(holds))

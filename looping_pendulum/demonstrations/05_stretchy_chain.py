"""A stretchy solver.

Question: The links of a chain have a fixed length. How long is the chain in a game engine that solves them one after the other?

Guess: As long as the sum of its links: that is what a joint is for.

Experiment: Beads along the whole string of the 10:1 trial in pymunk, 100 ms from the release, in steps of 0.1 ms. In each step
the solver sweeps over all joints so and so many times. First more sweeps, then heavier beads.

Change it: Give the heavy mass 20 g, so that the string has less to carry; or take links of 12 mm.
"""

from math import cos, exp, inf, sin

import matplotlib.pyplot as plt
import numpy as np
import pymunk

import looping_pendulum as lp

p = lp.load("ten_to_one").parameters
link, bead_radius = 6e-3, 1e-3  # [m]
times = np.linspace(0, 0.1, 101)  # [s]


def point_on_string(arc):
    """Return the point of the taut string that is `arc` [m] from the light mass at the release."""
    angle, along = p.release_angle, p.free_length - arc
    if along < 0:  # on the rod
        angle, along = p.release_angle + along / p.rod_radius, 0
    if angle < 0:  # hanging down to the heavy mass
        angle, along = 0, p.rod_radius * angle
    return p.rod_radius * cos(angle) - along * sin(angle), p.rod_radius * sin(angle) + along * cos(angle)


def simulate(sweeps, string_mass):
    """Return the chain's stretch and the light mass's place at all times [m]; the string's mass is a share of M1."""
    space = pymunk.Space()
    space.gravity, space.iterations, space.collision_slop = (0, -p.coefficients["gravity"]), sweeps, 1e-5
    rod = pymunk.Circle(space.static_body, p.rod_radius - bead_radius)
    rod.friction = p.coefficients["kinetic_friction"]
    space.add(rod)

    count = round(p.string_length / link)
    beads = [string_mass * p.light_mass / count] * (count - 1)
    bodies = [pymunk.Body(mass, inf) for mass in (p.light_mass, *beads, p.heavy_mass)]
    for body, arc in zip(bodies, np.linspace(0, p.string_length, count + 1), strict=True):
        body.position = point_on_string(arc)
        bead = pymunk.Circle(body, bead_radius)
        bead.friction, bead.filter = 1, pymunk.ShapeFilter(group=1)  # beads do not touch one another
        space.add(body, bead)
    joints = [pymunk.PinJoint(one, other) for one, other in zip(bodies, bodies[1:], strict=False)]
    for joint in joints:
        joint.error_bias = exp(-30)  # a wrong length shrinks by this factor in a second
    space.add(*joints)

    stretch, places = [], []
    for _ in times:
        nodes = np.array([body.position for body in bodies])
        stretch.append(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum() - sum(joint.distance for joint in joints))
        places.append(nodes[0])
        for _ in range(10):
            space.step(1e-4)
    return np.array(stretch), np.array(places)


exact = lp.solve_at(p, times).light_position
runs = {(sweeps, 0.01): simulate(sweeps, 0.01) for sweeps in (10, 30, 100)}
runs |= {(10, share): simulate(10, share) for share in (0.1, 0.3)}
longest = {key: 1e3 * stretch.max() for key, (stretch, _) in runs.items()}
for (sweeps, share), (_, places) in runs.items():
    off = 1e3 * np.sqrt(np.mean(np.sum((places - exact) ** 2, axis=1)))
    print(f"{sweeps:3} sweeps, string {share:3.0%} of M1: {longest[sweeps, share]:5.2f} mm too long, M1 {off:5.2f} mm off")

for ((sweeps, share), (stretch, _)), style in zip(runs.items(), ("-", "--", ":", "-.", "k-"), strict=True):
    plt.plot(times, 1e3 * stretch, style, label=f"{sweeps} sweeps, string {share:.0%} of M1")
plt.title("Fewer sweeps and lighter beads make a softer spring")
plt.xlabel("time [s]")
plt.ylabel("string too long by [mm]")
plt.legend()
plt.savefig("05_stretchy_chain.png")

print(f"""
Longer. With 10 sweeps a step (the default) the string is {longest[10, 0.01]:.0f} mm too long within a tenth of a
second. A correction runs from joint to joint, and after a few sweeps it has not yet come from one
end to the other: the chain is a spring.""")
assert longest[10, 0.01] > 5

print(f"""
More sweeps stiffen it: {longest[30, 0.01]:.1f} mm with 30; but even 100 leave {longest[100, 0.01]:.1f} mm.""")
assert longest[30, 0.01] < 0.6 * longest[10, 0.01]
assert 0.1 < longest[100, 0.01] < longest[30, 0.01]

print(f"""
Heavier beads stiffen it as well: {longest[10, 0.1]:.1f} mm and {longest[10, 0.3]:.1f} mm with 10 sweeps. But a string of
a third of the light mass is another apparatus than the one that was asked for.""")
assert longest[10, 0.3] < longest[10, 0.1] < 0.6 * longest[10, 0.01]

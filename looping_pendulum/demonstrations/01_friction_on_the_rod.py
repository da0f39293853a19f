"""A tendon without friction never halts.

Question: MuJoCo's tendon wraps round a cylinder. Is that enough for the heavy mass to be caught?

Guess: The tendon goes round the rod more and more often, so the heavy mass will be caught, a little later perhaps.

Experiment: The 10:1 trial, four times: the exact reference; MuJoCo's tendon as its documentation describes it; the same tendon,
to which the adapter gives the friction that the capstan law allows; and the reference with the friction set to 0.

Change it: Load "two_to_one" instead. Is the heavy mass caught later, or not at all?
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import looping_pendulum as lp

trial = lp.load("ten_to_one")
slippery = replace(trial, parameters=trial.parameters.replace(kinetic_friction=0))
exact = lp.engine("reference", profile="accurate")
runs = {
    "reference": exact.simulate(trial),
    "MuJoCo, as documented": lp.engine("mujoco:documented").simulate(trial),
    "MuJoCo, capstan law fed in": lp.engine("mujoco:capstan").simulate(trial),
    "reference without friction": exact.simulate(slippery),
}
reference, documented, fed_in, without_friction = runs.values()


def turns(run):
    """Count how often the heavy mass turns round; speeds below 2 cm/s are rest."""
    speed = run.heavy_velocity[:, 1]
    return np.count_nonzero(np.diff(np.sign(speed[abs(speed) > 0.02])))


def distance(run, other):
    """Return the RMS distance of the light mass between two runs to 0.35 s [mm]."""
    apart = run.light_position[:351] - other.light_position[:351]  # a sample each millisecond
    return 1e3 * np.sqrt(np.mean(np.sum(apart**2, axis=1)))


halt = {name: lp.landmarks(run, trial).halting_time for name, run in runs.items()}
for name, run in runs.items():
    rests = "never halts" if halt[name] is None else f"halts at {halt[name]:.4f} s"
    print(f"{name:28} {rests:18} falls {100 * run.heavy_drop.max():4.1f} cm at most, turns round {turns(run)} times")

styles = ("k-", "--", ":", "-.")
for i, (name, run) in enumerate(runs.items()):
    plt.plot(run.t, 100 * run.heavy_drop, styles[i], linewidth=4 - i, label=name)
plt.title("Without friction the heavy mass comes up again and again")
plt.xlabel("time [s]")
plt.ylabel("M2 has fallen by [cm]")
plt.legend()
plt.savefig("01_friction_on_the_rod.png")

print(f"""
No. The reference halts at {halt["reference"]:.3f} s; the tendon as documented turns round
{turns(documented)} times within a second and never rests.""")
assert halt["reference"] is not None
assert halt["MuJoCo, as documented"] is None
assert turns(documented) >= 2

print(f"""
The solver is not to blame. Up to 0.35 s it is {distance(documented, without_friction):.3f} mm from the reference without
friction, and {distance(documented, reference):.0f} mm from the reference: it solved another problem, and solved it well.""")
assert distance(documented, without_friction) < 0.05 * distance(documented, reference)

print(f"""
Give the same tendon the friction that the capstan law allows, and it halts at {halt["MuJoCo, capstan law fed in"]:.3f} s.
That tests MuJoCo's mechanics, not the law: the law was fed in.""")
assert abs(halt["MuJoCo, capstan law fed in"] - halt["reference"]) < 1e-3

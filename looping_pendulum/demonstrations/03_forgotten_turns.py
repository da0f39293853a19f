"""A tendon that forgets its turns.

Question: A tendon wraps round a cylinder on the side that its side site names. What does it know after a full turn?

Guess: The engine follows the string all the way round, as often as it likes.

Experiment: The reference; MuJoCo's tendon with the capstan law, where the adapter counts the turns and uses two tendons in
turn; and the same with one tendon for everything, which is what one side site gives.

Change it: Release the light mass at 60 deg (`release_angle`, in radians): it makes more turns before it reaches the rod.
"""

import matplotlib.pyplot as plt
import numpy as np

import looping_pendulum as lp

trial = lp.load("ten_to_one")
never = 1e4  # a wrap angle that no run reaches [rad]: the adapter never changes tendons
runs = {
    "reference": lp.engine("reference", profile="accurate").simulate(trial),
    "turns counted, two tendons in turn": lp.engine("mujoco:capstan").simulate(trial),
    "one tendon, turns forgotten": lp.engine("mujoco:capstan", switch_up=never).simulate(trial),
}
reference, counted, one = runs.values()


def wrap_angle_when_apart(run):
    """Return how much string is on the rod when the light mass is first 1 mm off [deg]; None: it never is."""
    n = min(len(run.t), len(reference.t))
    apart = np.linalg.norm(run.light_position[:n] - reference.light_position[:n], axis=1) > 1e-3
    return np.degrees(reference.wrap_angle[apart.argmax()]) if apart.any() else None


halt = {name: lp.landmarks(run, trial).halting_time for name, run in runs.items()}
wrong_length = {name: 1e3 * np.nanmax(abs(run.string_stretch)) for name, run in runs.items()}
for name, run in runs.items():
    print(f"{name:36} halts at {halt[name]:.4f} s, falls {100 * run.heavy_drop.max():.1f} cm at most,", end=" ")
    print(f"length wrong by {wrong_length[name]:.4f} mm")

forgotten = wrap_angle_when_apart(one)
styles = ("k-", "--", ":")
for i, (name, run) in enumerate(runs.items()):
    plt.plot(run.t, 100 * run.light_position[:, 1], styles[i], linewidth=3 - i, label=name)
plt.title("One tendon leaves the reference before the first turn is complete")
plt.xlabel("time [s]")
plt.ylabel("M1's height [cm]")
plt.legend()
plt.savefig("03_forgotten_turns.png")

print(f"""
It knows nothing of turns: a tendon is the shortest way round at this instant. It follows the
reference up to {forgotten:.0f} deg of string on the rod; there another way becomes the shorter one, and
without a warning its length is wrong by {wrong_length["one tendon, turns forgotten"]:.0f} mm.""")
assert 180 < forgotten < 360
assert wrong_length["one tendon, turns forgotten"] > 5

print(f"""
With the turns counted, the light mass is never 1 mm off and the length keeps to
{wrong_length["turns counted, two tendons in turn"]:.4f} mm.""")
assert wrap_angle_when_apart(counted) is None
assert wrong_length["turns counted, two tendons in turn"] < 0.01

print(f"""
The one tendon cannot halt the heavy mass as the reference does at {halt["reference"]:.3f} s: it says
{halt["one tendon, turns forgotten"]:.3f} s.""")
assert abs(halt["one tendon, turns forgotten"] - halt["reference"]) > 0.02

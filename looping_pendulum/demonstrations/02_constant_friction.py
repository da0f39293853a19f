"""Constant friction is not a capstan.

Question: MuJoCo has a friction for tendons, a constant in newtons. Does one of the right size halt the heavy mass as the rod
does?

Guess: Friction is friction: with the right number it will come out about right.

Experiment: The reference, and MuJoCo's tendon with its own constant friction loss in three sizes that the reference itself
suggests: its friction at the release, its mean over the way that the string slides, and its friction just before the halt.

Change it: Load "two_to_one" instead, or set another `kinetic_friction`: how does the friction before the halt grow?
"""

import matplotlib.pyplot as plt

import looping_pendulum as lp
from looping_pendulum.engines.mujoco.tendon import FrictionSize, friction_loss

trial = lp.load("ten_to_one")
reference = lp.engine("reference", profile="accurate").simulate(trial)
sizes = {
    "as at the release": FrictionSize.AT_RELEASE,
    "the mean": FrictionSize.EQUAL_WORK,
    "as before the halt": FrictionSize.AT_HALT,
}
runs = {name: lp.engine("mujoco:frictionloss", friction_size=size).simulate(trial) for name, size in sizes.items()}
constant = {name: friction_loss(trial.parameters, size) for name, size in sizes.items()}
halt = {name: lp.landmarks(run, trial).halting_time for name, run in runs.items()}

halts_at = lp.landmarks(reference, trial).halting_time
friction = reference.heavy_tension - reference.light_tension  # of the string on the rod [N]
at_release, before_halt = abs(friction[0]), abs(friction[int(1e3 * halts_at)])  # a sample each millisecond
print(f"reference: {at_release:.2f} N at the release, {before_halt:.2f} N before the halt at {halts_at:.4f} s")
for name, run in runs.items():
    rests = "never halts" if halt[name] is None else f"halts at {halt[name]:.4f} s"
    print(f"{constant[name]:.2f} N, {name + ':':20} {rests:18} falls {100 * run.heavy_drop.max():5.1f} cm at most")

strongest = 100 * runs["as before the halt"].heavy_drop.max()
plt.plot(reference.t, 100 * reference.heavy_drop, "k", label="reference")
for (name, run), style in zip(runs.items(), ("--", ":", "-."), strict=True):
    plt.plot(run.t, 100 * run.heavy_drop, style, label=f"{constant[name]:.2f} N, {name}")
plt.title("Two constants do not hold the heavy mass, one is too strong to let it go")
plt.xlabel("time [s]")
plt.ylabel("M2 has fallen by [cm]")
plt.legend()
plt.savefig("02_constant_friction.png")

print(f"""
None of the three. The small and the mean one never halt the heavy mass; the large one never
lets it fall ({strongest:.1f} cm).""")
assert halt["as at the release"] is None
assert halt["the mean"] is None
assert strongest < 0.1

print(f"""
The reference's friction is no constant: {at_release:.2f} N at the release, {before_halt:.2f} N before the halt. The capstan law
multiplies what the light mass pulls by exp(mu theta); as the light mass whips round, both its pull
and the angle on the rod grow.""")
assert before_halt > 5 * at_release

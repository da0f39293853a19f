"""Static against kinetic friction at the break-away.

Question: A resting string grips better than a sliding one. When does that matter?

Guess: A better grip makes everything stop earlier.

Experiment: The exact model of the 2:1 trial, where the string sticks, slips again and sticks for good, with a static friction
1, 1.2 and 1.5 times the kinetic one.

Change it: Try ratios between 1.2 and 1.5. Where does the motion change?
"""

from dataclasses import replace

import matplotlib.pyplot as plt

import looping_pendulum as lp

trial = lp.load("two_to_one")
kinetic = trial.parameters.coefficients["kinetic_friction"]
exact = lp.engine("reference", profile="accurate")
runs, first, lowest = {}, {}, {}
for ratio in (1.0, 1.2, 1.5):
    parameters = trial.parameters.replace(static_friction=ratio * kinetic)
    run = exact.simulate(replace(trial, parameters=parameters, duration=2.5))
    runs[ratio] = run
    first[ratio] = {event.name: event.time for event in reversed(run.events)}
    lowest[ratio] = 100 * run.heavy_drop.max()
    print(f"static / kinetic = {ratio}: falls {lowest[ratio]:.1f} cm at most;", end=" ")
    print(", ".join(f"{name} at {first[ratio][name]:.4f} s" for name in ("stop", "stick", "slip_onset", "halt")))

styles = ("k-", "--", ":")
for i, (ratio, run) in enumerate(runs.items()):
    plt.plot(run.t, 100 * run.heavy_drop, styles[i], linewidth=3 - i, label=f"static / kinetic = {ratio}")
plt.title("Nothing differs until the string first rests")
plt.xlabel("time [s]")
plt.ylabel("M2 has fallen by [cm]")
plt.legend()
plt.savefig("08_static_friction.png")

print(f"""
While the string slides, static friction does nothing: all three come to their first stop at {first[1.0]["stop"]:.4f} s.""")
stops = [first[ratio]["stop"] for ratio in runs]
assert max(stops) - min(stops) < 1e-6

print(f"""
At 1.2 it only delays the break-away, from {first[1.0]["slip_onset"]:.4f} s to {first[1.2]["slip_onset"]:.4f} s.""")
assert first[1.2]["slip_onset"] > first[1.0]["slip_onset"] + 2e-3
assert abs(first[1.2]["stick"] - first[1.0]["stick"]) < 1e-9

print(f"""
At 1.5 the story is another one: the string already holds at the first stop ({first[1.5]["stick"]:.4f} s), where before it
ran back, and the heavy mass falls {lowest[1.5]:.1f} cm at most instead of {lowest[1.0]:.1f} cm. A threshold, not a gradual
change: a fit that follows slopes cannot see it coming.""")
assert first[1.5]["stick"] < first[1.0]["stick"] - 0.05
assert lowest[1.5] < lowest[1.0] - 1

"""The string that winds on itself.

Question: After a full turn the string lies on string, which grips better than the rod, and makes it thicker. Does it matter?

Guess: Better grip and a thicker rod stop the heavy mass earlier.

Experiment: The exact model, with a friction of 0.1 per radian added where string lies on string, and with a string that makes
the rod 0.5 mm thicker per turn; on the rod of the 10:1 trial and on a slippery one (friction 0.05).

Change it: How slippery must the rod be for the grip of string on string to decide?
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import looping_pendulum as lp

trial = lp.load("ten_to_one")
exact = lp.engine("reference", profile="accurate")
changes = {
    "10:1 trial": {},
    "string grips string": {"string_on_string": 0.1},
    "string thickens the rod": {"string_thickness": 5e-4},
    "slippery rod": {"kinetic_friction": 0.05},
    "slippery rod, string grips string": {"kinetic_friction": 0.05, "string_on_string": 0.1},
}
runs, first, wound = {}, {}, {}
for name, changed in changes.items():
    run = exact.simulate(replace(trial, parameters=trial.parameters.replace(**changed), duration=2))
    runs[name] = run
    first[name] = {event.name: event.time for event in reversed(run.events)}
    wound[name] = np.degrees(np.interp(first[name].get("halt", np.nan), run.t, run.wrap_angle))
    print(f"{name:34} falls {100 * run.heavy_drop.max():.1f} cm at most;", end=" ")
    seen = [event for event in ("stick", "slip_onset", "halt", "light_reaches_rod") if event in first[name]]
    print(", ".join(f"{event} at {first[name][event]:.3f} s" for event in seen))
plain, grip, thick, slippery, slippery_grip = first.values()

styles = ("k-", "--", ":", "-.", "C3-")
for i, (name, run) in enumerate(runs.items()):
    plt.plot(run.t, 100 * run.heavy_drop, styles[i], linewidth=5 - i, label=name)
plt.title("On a slippery rod, string on string makes the difference")
plt.xlabel("time [s]")
plt.ylabel("M2 has fallen by [cm]")
plt.legend()
plt.savefig("09_string_on_string.png")

print(f"""
In the 10:1 trial the grip of string on string does nothing: the heavy mass halts with {wound["10:1 trial"]:.0f} deg of
string on the rod, before the first turn is complete.""")
assert wound["10:1 trial"] < 360
assert abs(grip["halt"] - plain["halt"]) < 1e-6

print(f"""
On a slippery rod it decides the end: without it the string first holds at {slippery["stick"]:.3f} s and slips again
at {slippery["slip_onset"]:.3f} s; with it, it holds for good from {slippery_grip["halt"]:.3f} s on,
{wound["slippery rod, string grips string"]:.0f} deg being on the rod.""")
assert slippery_grip["halt"] < slippery["stick"] < slippery["slip_onset"]
assert wound["slippery rod, string grips string"] > 360

earlier = 1e3 * (plain["light_reaches_rod"] - thick["light_reaches_rod"])
print(f"""
The thickness does not move the halt, but what follows: string is used up faster on a thicker rod, and
the light mass arrives {earlier:.0f} ms earlier.""")
assert abs(thick["halt"] - plain["halt"]) < 1e-6
assert earlier > 5 * 1000 / 240  # five frames of a phone's slow motion

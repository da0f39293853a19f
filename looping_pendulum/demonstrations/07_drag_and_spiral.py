"""Drag makes the spiral right.

Question: After the halt the light mass winds in on a spiral. The air's drag on 10 g is tiny: may it be left out?

Guess: A drag of a few 1e-4 kg/m changes nothing that one could see on a video.

Experiment: The exact model of the 10:1 trial with the drag that the scenario has, without drag, and with twice that. On the
spiral of the paper, l + R theta is constant; its length l falls as sqrt(t_end - t), if gravity and drag are neglected.

Change it: Leave out one of the three drags only. Which one matters?
"""

import matplotlib.pyplot as plt
import numpy as np

import looping_pendulum as lp

p = lp.load("ten_to_one").parameters
frame = 1000 / 240  # of a phone's slow motion [ms]
drags = ("light_drag", "heavy_drag", "string_drag")
runs = {
    label: lp.solve(p.replace(**{name: factor * p.coefficients[name] for name in drags}))
    for label, factor in (("drag as in the scenario", 1), ("no drag", 0), ("twice the drag", 2))
}
declared, none, _ = runs.values()
samples = {label: run.sample(np.arange(0, run.end_time, 1e-3)) for label, run in runs.items()}

off_spiral = {}
for label, run in runs.items():
    halted = run.sample(np.arange(run.halting_time, run.end_time, 1e-3))
    t, length, angle = halted.t, halted.state.free_length, halted.state.wrap_angle
    off_spiral[label] = 1e3 * np.ptp(length + p.rod_radius * angle)
    formula = length[0] * np.sqrt((run.end_time - t) / (run.end_time - t[0]))
    print(f"{label:24} halts at {run.halting_time:.4f} s, M1 reaches the rod at {run.end_time:.4f} s;", end=" ")
    print(f"l off the formula: {1e3 * abs(length - formula).max():.1f} mm")

styles = ("k-", "--", ":")
for i, (label, run) in enumerate(samples.items()):
    plt.plot(run.t, 100 * run.light_position[:, 1], styles[i], linewidth=3 - i, label=label)
plt.title("The three agree up to the halt; then less drag runs ahead, loop by loop")
plt.xlabel("time [s]")
plt.ylabel("M1's height [cm]")
plt.legend()
plt.savefig("07_drag_and_spiral.png")

print(f"""
The shape of the spiral knows nothing of drag: with and without it, l + R theta is constant to
{off_spiral["drag as in the scenario"]:.0e} mm and {off_spiral["no drag"]:.0e} mm.""")
assert max(off_spiral.values()) < 1e-6

earlier = 1e3 * (declared.end_time - none.end_time)
ahead = samples["no drag"].light_position[:1001] - samples["drag as in the scenario"].light_position[:1001]
distance = 1e3 * np.sqrt(np.mean(np.sum(ahead**2, axis=1)))
print(f"""
The clock does. Without drag the light mass reaches the rod {earlier:.1f} ms earlier, which is more than
5 frames at 240 a second, and is {distance:.0f} mm from where it should be (root mean square to 1.0 s).""")
assert earlier > 5 * frame
assert distance > 5

halts_earlier = 1e3 * (declared.halting_time - none.halting_time)
print(f"""
The halt hardly tells: it moves by {halts_earlier:.1f} ms, less than one frame. So a model that is right up to the
halt may still lack the drag.""")
assert 0 < halts_earlier < frame

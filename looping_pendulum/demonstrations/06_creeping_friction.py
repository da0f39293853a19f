"""A regularised friction creeps.

Question: A string that sticks does not move. Does a simulated one?

Guess: Once the heavy mass is caught it stands still.

Experiment: MuJoCo's friction is softened: the friction force is a smooth function of the sliding speed, so what is held must
slide a little to be held. Two numbers set how much, a time constant and an impedance. The tendon with the capstan law, with
both made hard, with the default time constant of 20 ms, and with both as they come. Creep is measured from 0.45 to 1 s, when
the reference's string holds.

Change it: Give the heavy mass 60 g: the string is held less tightly. Does it creep more?
"""

import matplotlib.pyplot as plt

import looping_pendulum as lp

trial = lp.load("ten_to_one")
slow = {"friction_time_constant": 0.02}
soft = slow | {"impedance": 0.95, "least_impedance": 0.9}
runs = {
    "reference": lp.engine("reference", profile="accurate").simulate(trial),
    "1 ms, hard": lp.engine("mujoco:capstan").simulate(trial),
    "20 ms, hard": lp.engine("mujoco:capstan", **slow).simulate(trial),
    "20 ms, soft (as it comes)": lp.engine("mujoco:capstan", **soft).simulate(trial),
}
halt = {name: lp.landmarks(run, trial).halting_time for name, run in runs.items()}
late = {name: None if time is None else 1e3 * (time - halt["reference"]) for name, time in halt.items()}
creep = {name: 1e3 * (run.heavy_position[1000, 1] - run.heavy_position[450, 1]) for name, run in runs.items()}
for name in runs:
    rests = "never halts" if halt[name] is None else f"halts {late[name]:+7.3f} ms late"
    print(f"{name:26} {rests:22} creeps {creep[name]:+z.5f} mm while held")

styles = ("k-", "--", ":", "-.")
for i, (name, run) in enumerate(runs.items()):
    height = 1e3 * run.heavy_position[:, 1]
    plt.plot(run.t, height - height.min(), styles[i], linewidth=4 - i, label=name)
plt.xlim(0.36, 1)
plt.ylim(-0.5, 10)
plt.title("Softened friction lets the caught mass creep up")
plt.xlabel("time [s]")
plt.ylabel("M2 above its lowest point [mm]")
plt.legend()
plt.savefig("06_creeping_friction.png")

print(f"""
With the settings as they come it does not stand still, and so it never halts: the light mass, still
whipping round, pulls it up by {creep["20 ms, soft (as it comes)"]:.1f} mm while it is held; the reference's string
does not move.""")
assert halt["20 ms, soft (as it comes)"] is None
assert creep["20 ms, soft (as it comes)"] > 0.5
assert abs(creep["reference"]) < 1e-6

print(f"""
The time constant alone makes the halt {late["20 ms, hard"]:.0f} ms late.""")
assert late["20 ms, hard"] > 10

print(f"""
Hard settings bring the creep down to {creep["1 ms, hard"]:.5f} mm and the halt to {late["1 ms, hard"]:.3f} ms.""")
assert abs(creep["1 ms, hard"]) < 1e-3
assert abs(late["1 ms, hard"]) < 0.1

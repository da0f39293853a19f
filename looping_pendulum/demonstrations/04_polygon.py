"""A polygon is not a circle.

Question: A chain of links over a rod is a polygon. Does it have the friction of a string over a circle?

Guess: If the friction coefficient of the contact is right, the friction is right.

Experiment: pymunk's beads slide over the rod with half a turn on it, contact friction 0.34. The two masses' accelerations give
the tensions on either side, and so the exponent ln(T2 / T1), which for a string is mu theta. Links of four lengths, with the
friction as it is, and corrected for the corners.

Change it: Set another friction `mu`, or a wrap angle between 90 and 270 deg.
"""

from math import pi

import matplotlib.pyplot as plt
import numpy as np

import looping_pendulum as lp
from looping_pendulum.engines.static_capstan import chain_capstan_exponent, measure_capstan_exponent

mu = 0.34
bends = np.array([0.2, 0.4, 0.8, 1.2])  # between neighbouring links on the rod [rad]


def too_large(bend, corrected):
    """Return by how much the exponent of a chain exceeds mu theta [%]."""
    chain = lp.engine("pymunk:chain", bend=bend, polygon_friction=corrected)
    return 100 * measure_capstan_exponent(chain, friction=mu, wrap_angle=pi).error


def formula(bend):
    """Return the same by the closed form of a chain with corners, 2 N artanh(mu tan(theta / 2N))."""
    return 100 * (chain_capstan_exponent(mu, pi, bend) / (mu * pi) - 1)


plain = np.array([too_large(bend, corrected=False) for bend in bends])
corrected = np.array([too_large(bend, corrected=True) for bend in bends])
predicted = np.array([formula(bend) for bend in bends])
print("ln(T2 / T1) too large, measured, by the formula, and corrected for the corners")
for bend, *errors in zip(np.degrees(bends), plain, predicted, corrected, strict=True):
    print(f"links bent by {bend:.0f} deg:" + "".join(f" {error:+7.2f} %" for error in errors))

finely = np.linspace(0.02, bends[-1], 60)
plt.plot(finely, [formula(bend) for bend in finely], "k", label="formula: 2 N artanh(mu tan(theta / 2N))")
plt.plot(bends, plain, "o", label="beads with friction mu")
plt.plot(bends, corrected, "s", label="beads, friction corrected for the corners")
plt.title("What corners add to the friction of a chain")
plt.xlabel("bend between two links on the rod [rad]")
plt.ylabel("ln(T2 / T1) too large by [%]")
plt.legend()
plt.savefig("04_polygon.png")

print(f"""
No. At a corner the chain presses on the rod more than a string does. With links bent by 46 deg
the exponent is {plain[2]:.1f} % too large, with 23 deg {plain[1]:.1f} %, with 11 deg {plain[0]:.2f} %.""")
assert plain[2] > 4
assert plain[1] > 1
assert 0 < plain[0] < plain[1]

print(f"""
Half the link, a quarter of the error: from 46 to 23 deg it falls by a factor of {plain[2] / plain[1]:.1f}. A closed
form of a chain with corners tells all four, to a fifth.""")
assert 3 < plain[2] / plain[1] < 5.5
assert np.all(abs(plain - predicted) < np.maximum(0.2 * predicted, 0.2))

print(f"""
Once that is known, the contact's friction can be made smaller by as much: then {corrected[2]:.2f} % are left at
46 deg and {corrected[0]:.2f} % at 11 deg.""")
assert np.all(abs(corrected) < 0.3 * plain)

"""What is assumed before a trial's points are looked at: how often a mistake is made, and how large errors are.

No account is named unless the points are so much more probable with it that these shares are made up for.
"""

COMMON, RARE = 1e-4, 2e-6
"""Prior probabilities of one mistake: one film in a thousand has any of ten common ones. Of two at once it is the product."""
UNEVEN_SHARE = 1e-3
"""Prior probability that frames are uneven at random: a recorder's often are."""
EVEN_SHARE = 1e-2
"""Prior probability that times which are uneven are not those of the frames."""
SMOOTHED_SHARE = 1e-3
"""Prior probability that a film's points are not as they were tracked."""
CHANGES = 2.0
"""Number of changes of the times that a film with any has on average."""
RIVAL = 20.0
"""Largest ratio of the probability of the best account to that of another one that is named beside it."""
LACKING = (2e-3, 20e-3, 200e-3)
"""Distances by which what the model lacks moves a mass in half a second [m]: of nothing much, an effect, a large one."""
BEGINNING = (20e-3, 200e-3, 2.0)
"""Sizes of what begins to act later, as `LACKING`: what takes hold at once moves a mass more."""
AT_REST = 0.01
"""Standard error of a mass's speed at the release [m/s]."""
SMOOTH = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Distances by which a smooth motion of any kind leaves a straight line over all points, in the range of these."""
NOISES = (0.7, 1.0, 1.4)
"""Noise of a body's points, in what its points alone show."""
LEAST_NOISE = 1e-4
"""Smallest noise in the range of the points: the motion is not computed more exactly, and no film shows more."""
KNOWN_NOISE = 4.0
"""How well the noise is known beforehand, in numbers of points."""
BLURS = (1e-4, 3e-4)
"""Growth of a point's error with its speed: half an exposure [s]."""
UNREST = 0.02
"""Error of the time of every row [steps]."""
SLIPS = 0.01
"""Share of a body's points in which the tracker slips, to any place in the range of its points."""
STICKS, STAYS = 1e-4, 0.7
"""Share of a body's points at which the tracker begins to stay where it was, and share of those in which it goes on to."""
COPIES = (0.02, 0.1, 0.3)
"""Noise with which a picture that is stored again is marked again, in that of the points; in half of all cases it is new."""
WHITE = 0.03
"""White part of the errors of smoothed points, in what differences of neighbours show: their last digit."""
WANDERS = (0.5, 1.0, 3.0, 10.0)
"""Errors of a tracker that wanders over its mark, in its white noise."""

"""What is assumed before a trial's points are looked at: how often each mistake is made, and how large errors are.

A hypothesis is named only if the points are so much more probable with it that its share is made up for.
"""

# How often a mistake is made, as prior probabilities
COMMON, RARE = 1e-4, 2e-6
"""Of one mistake: one film in a thousand has any of ten common ones. Of two at once it is the product."""
UNEVEN_SHARE, EVEN_SHARE = 1e-3, 1e-2
"""That frames are uneven at random, as a recorder's often are; that uneven times are not those of the frames."""
SMOOTHED_SHARE = 1e-3
"""That a film's points are not as they were tracked."""
LATER_SHARE = 1e-2
"""That what the model lacks begins to act within the film."""
CHANGES = 2.0
"""Number of changes of the times that a film with any has on average."""
RIVAL = 20.0
"""Least ratio of probabilities by which a hypothesis is preferred to the table, and largest of those named with "or"."""

# What the declared model lacks
LACKING = (2e-3, 20e-3, 200e-3)
"""Distances by which it moves a mass in half a second [m]: of nothing much, an effect, a large one."""
USUAL_DRAG = 1e-3
"""Coefficient of the air's drag on a light mass of some centimetres [kg/m]; nothing is known of it if it is not declared."""
LATER = 10.0
"""How many times more what begins within the film moves a mass: it takes hold at once."""
MODES = 8
"""Number of shapes of it in each coordinate."""
OPEN_FACTOR = 0.15
"""Standard error of a clock's ratio or a scale of which a hypothesis says that it was stated wrongly."""
CAMERA_ERRORS = {"clock_offset": 0.0, "clock_ratio": 0.03, "scale": 0.03, "tilt": 0.03, "rate_offset": 0.0}
"""What a camera may get wrong by little -> its standard error [SI]; 0: that of the study's prior."""

# Errors of points
SLIPS, STAYS = 0.01, 1e-4
"""Shares of a body's points at which the tracker slips to anywhere in the picture, or stays where it was."""
KNOWN_NOISE = 8.0
"""How well the noise is known beforehand, in numbers of points."""
BLUR = 2e-4
"""Growth of a point's error with its speed: half an exposure [s]."""
COPIES = (0.02, 0.1, 0.3)
"""Noise with which a picture that is stored again is marked again, in that of the points."""
WHITE = 0.03
"""White part of the errors of smoothed points, in what differences of neighbours show: their last digit."""
WANDERS, WANDER_FRAMES = (1.0, 3.0, 10.0), (4.0, 10.0, 24.0)
"""Errors of a tracker that wanders over its mark, in its white noise, and frames for which they last."""
HAND_ACCELERATIONS, MOVED_BY_HAND = (5.0, 50.0, 500.0), 0.01
"""Accelerations of a mass that a hand stops [m/s^2], and share of the rows of a mass that is held in which it moves."""

# Errors of times
UNREST = 0.02
"""Error of the time of every row [steps]."""
UNEVEN = (0.06, 0.12, 0.25)
"""The same of uneven frames."""
LATE_IN_TURN = 0.25
"""Standard error of the lateness of frames that are late in turn [steps]."""
RATES = (1.0, 1 / 8, 1 / 4, 1 / 2, 2.0, 4.0, 8.0)
"""How long a row may last, in what the file says."""
LOST = (1, 2, 3)
"""Numbers of pictures that may be lost at one place."""

# What counts as explained
MAX_LEFT = 0.01
"""Largest distance that an effect leaves most points, as it bends a motion and does not scatter its points [free lengths]."""
MAX_MISFIT, MAX_WHITE = 1.5, 2**0.5
"""Largest root mean square of what is left, in the noise that the points' differences show: a tracker that wanders has more;
and the largest of errors whose larger part is white."""
MIN_SHARE, CLEAN_SHARE = 0.8, 0.97
"""Least share of the points that show their body, and where only noise is left."""
MAX_LEFT_OUT = 0.2
"""Largest share of the points before the model's end that are left out without a hypothesis that explains the others."""

"""Everything that is decided about explanations before the data are seen: their prior, and the limits of the search.

An explanation is a set of parts: listed effects, or one law of unknown form and at most one effect beside it. Nothing else in
the search is chosen; what follows from the data and these numbers is computed.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq
from scipy.special import poch

from looping_pendulum.reference_ode.geometry import Array

# How likely
P_OF_EFFECTS = (0.5, 0.3, 0.08, 0.02)
"""Prior probability that so many listed effects are missing, and nothing else: none, one, two, three."""
P_OF_LAW = (0.08, 0.02)
"""Prior probability that a law of unknown form is missing: alone, and beside one listed effect."""
P_LASTING = 0.3
"""Prior probability that errors of the tracked points last longer than a frame."""
# How large
LOG_RANGE = math.log(1000.0)
"""Logarithm of the range of an effect's size, in which all decades are alike.

From tenths of a millimetre, which hardly any tracker shows, to decimetres of the light mass's motion.
"""
T_FREEDOM = 3.0
"""Degrees of freedom of Student's t, by which a value of the apparatus is wrong in units of its stated error.

Measurements differ so in units of their stated errors, often more (Bailey, Royal Society Open Science 4 (2017) 160600).
"""
# From 10 uN, which move 10 g by a tenth of a millimetre in half a second, to 1 N, about the heavy mass's weight
RIDGES = np.logspace(-5, 0, 41)
"""Standard deviations of a law's weights, all alike [N, or 1 for friction]."""
LENGTHS = (0.0, 1.5, 4.0)
"""Correlation lengths of a law's weights [basis functions], all alike: how smooth it is, beside their own width."""
POINT_SIGMA = 0.3
"""Prior standard deviation of either coordinate of the point from which a law's distance is measured [m]."""
AMPLITUDES = (0.2, 0.5, 1.5, 4.0, 12.0)
"""Amplitudes [white sigma] of errors that last longer than a frame, for each of the `fit.data.FRAMES` that they may last.

The least can still treble the variance of what a fit averages over frames: 1 + 2 x 0.2^2 x 24.
"""
# What is looked at and said
VISIBLE = 4.0
"""Standard errors from which on an effect is large enough to be seen, by the sizes that a report calls visible."""
CREDIBLE = 0.95
"""Probability of the explanations that a verdict names."""
DECISIVE = math.log(CREDIBLE / (1 - CREDIBLE))
"""Log of the factor from which on the held-out trials by themselves confirm an explanation, or below 0 contradict it.

Of densities of the same data, this is its own uncertainty: whichever of two explanations is right, the probability that the
held-out trials favour the other one by a factor k is at most 1 / k.
"""
LAW_PREDICTS = math.log(1000.0)
"""The same for a law, which they have to confirm.

A law can take any form, and what two trials of one camera have in common may be the camera's.
"""
TIE = 3.0
"""Factor by which the probability of all others may be below that of `CREDIBLE` and still be a tie, as priors are not known
better than this."""
CHECKED = math.log(1000.0)
"""Log odds between the best explanations within which their probabilities are computed by sampling, too."""
MARGIN = 6.0
"""Log odds to the best explanation within which others are fitted exactly.

What this, `LINEAR_ERROR` and `BEAM` leave out is measured by `research.left_out`.
"""
LINEAR_ERROR = 0.35
"""Share of what is left to explain by which the linear model may be wrong.

Beside the declared model its gains are right to a twentieth, beside a wrong clock sometimes to a half.
"""
BEAM = 3
"""Best explanations of each kind to which everything is added while the best one leaves a misfit."""
MAX_EFFECTS = 3
"""Listed effects of an explanation at most."""


def log_prior(count: int, library: int, log_share_of_law: float | None = None) -> float:
    """Return the log of the prior probability of one explanation.

    Parameters
    ----------
    count, library
        Number of its listed effects, and of those that there are.
    log_share_of_law
        Log of its law's share of the prior of all laws; None: it has none.
    """
    ways = math.log(math.comb(library, count))
    if log_share_of_law is None:
        return math.log(P_OF_EFFECTS[count]) - ways
    return math.log(P_OF_LAW[count]) - ways + log_share_of_law


def least_distance(library: int) -> float:
    """Return how many standard errors an effect must be large to be more probable than that nothing is missing.

    Parameters
    ----------
    library
        Number of listed effects that there are.
    """
    odds = log_prior(1, library) - log_prior(0, library)
    return float(brentq(lambda z: 0.5 * z**2 + float(log_occam(np.array(z))) + odds, 1.0, 10.0))


def log_occam(z: Array, error: Array | float = math.nan) -> Array:
    """Return the log of the posterior's width over the prior's for an effect that is ``z`` standard errors large.

    It is not above 0, since what is smaller than its error tells nothing of its size.

    Parameters
    ----------
    error
        Standard error of an effect that is a wrong value, in units of the error with which that was stated; nan: of any other.
    """
    return np.asarray(np.minimum(log_density(z, error) + 0.5 * math.log(2 * math.pi), 0.0))


def log_density(z: Array, error: Array | float = math.nan) -> Array:
    """Return the log of the prior density of an effect per standard error, ``z`` of them from where it is absent.

    The parameters are those of `log_occam`. It is uniform in the logarithm of the size or, of a wrong value, Student's t.
    """
    size = np.maximum(np.abs(z), 1e-9)
    of_size = -np.log(size) - math.log(2 * LOG_RANGE)
    # Student's t, as `scipy.stats.t` has it, whose import takes as long as that of everything else
    log_norm = np.log(poch(0.5 * T_FREEDOM, 0.5)) - 0.5 * (np.log(T_FREEDOM) + np.log(np.pi))
    of_error = log_norm - (T_FREEDOM + 1) / 2 * np.log1p((size * error) ** 2 / T_FREEDOM) + np.log(error)
    return np.asarray(np.where(np.isnan(error), of_size, of_error))

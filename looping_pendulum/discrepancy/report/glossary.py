"""The report's words, for a reader who has seen a laboratory course but no statistics."""

from __future__ import annotations

GLOSSARY: dict[str, str] = {
    "declared model": "the physics that the study file says acts, with the numbers it gives, each within its stated error.",
    "calibration": "finding the numbers (masses, lengths, camera) within their stated errors that fit the trials best.",
    "repaired model": "the declared model plus what was found to be missing.",
    "mark": "where the video analysis saw a mass in one frame.",
    "residual": "measured less predicted. If the model is right, only noise is left: no pattern.",
    "noise": "how much marks scatter from frame to frame for no reason of physics; errors are given in units of it.",
    "RMS": "root mean square: the typical size of many residuals; square them, average, take the root.",
    "effect": "one piece of physics that may be missing: a drag, a thick string, a rod that turns, a wrong scale.",
    "candidate": "an effect from the library that was tried as an explanation.",
    "score": "how strongly the residuals look like that effect, in standard errors; above about 4 is no accident.",
    "gain": "how much better the data are explained, less a price for every number added (Bayesian information criterion).",
    "standard error": "how far the value may be off by chance: two times in three it is closer than this.",
    "chi2 per value": "average squared residual in units of noise: about 1 if nothing is missing, larger if something is.",
    "held out": "a trial that no fit has seen: an explanation must fit it too, or it is only a story about the others.",
    "ambiguous": "several explanations fit equally well; the report says which experiment would tell them apart.",
}
"""Word -> meaning."""

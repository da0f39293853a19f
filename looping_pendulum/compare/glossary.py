"""The report's words, for a reader who teaches physics rather than simulation."""

from __future__ import annotations

GLOSSARY: dict[str, str] = {
    "light mass, heavy mass": "the small bob that loops around the rod (M1), and the large one that falls and is caught (M2).",
    "truth": "the exact mathematical model of the apparatus, solved far more finely than any engine; not the measured trial.",
    "engine": "a general physics simulation program (pymunk, MuJoCo, PyBullet) in which the same apparatus was built.",
    "deviation": "how far the engine's light mass is from the truth's at the same moment, in millimetres.",
    "RMS": "root mean square: the typical deviation up to a time; square it at each moment, average, take the root.",
    "tube": "a sample is inside if the truth passes within 5 mm of it, give or take 5 ms: a small delay is forgiven.",
    "stop": "the heavy mass's speed is zero, if only for an instant.",
    "halting time": "when the string stops sliding over the rod and does not slide by more than 0.1 mm again until the light "
    "mass reaches the rod, or the run ends. It is read from samples a millisecond apart, for truth and engines in one way.",
    "blur": "by how much a quarter more or less than 0.1 mm moves a halting time.",
    "first rest, rebound": "from the first rest on the string stays within 1 mm; what it still moves is its rebound, or creep.",
    "not comparable": "one side was not watched long enough to have what the other has, or to show that it does not.",
    "lacks": "physics that the scenario has and the engine's run went without, as its adapter declares.",
    "break-away": "the rod can no longer hold the string, and a resting heavy mass moves again.",
    "drop": "how far the heavy mass is below where it was let go.",
    "wrap angle": "how much string lies on the rod, as an angle: it grows by 6.28 rad with every loop of the light mass.",
    "free length": "the straight piece of string from the rod to the light mass.",
    "slack": "the string carries no tension: both masses fly freely until it is taut again.",
    "capstan law": "a wound string holds a tension that grows exponentially with the wrap angle: T2 = T1 exp(mu theta).",
    "stretch": "how much longer than its rest length an engine let the string become; the truth's does not stretch.",
    "growth": "how fast a deviation grew from 1 to 10 mm, as the rate of an exponential; large: small errors matter.",
    "expected failure": "a limit that the engine is known not to keep, for the reason given; keeping it fails too.",
}
"""Word -> meaning."""

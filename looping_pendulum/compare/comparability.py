"""Decides whether a run was simulated for long enough to compare its halting time with the reference's."""

from __future__ import annotations

from looping_pendulum.compare.reference_landmarks import SampledReference
from looping_pendulum.engines.landmarks import Landmarks
from looping_pendulum.engines.string_motion import MIN_REST
from looping_pendulum.engines.trajectory import RunStatus, Trajectory


def why_not_comparable(run: Trajectory, own: Landmarks, reference: SampledReference) -> str:
    """Return why the halt of ``run``, or its lack of one, cannot be compared with the reference's; empty: it can.

    A run that ended because its light mass reached the rod is complete. One that was cut must last for `MIN_REST` beyond the
    reference's halt, or it can neither confirm nor refute that halt. If the reference never halts, a cut run that is at rest at
    its end is not comparable where the reference is at rest at that time as well: the reference slides again later.

    Parameters
    ----------
    own
        Landmarks of ``run``.
    """
    if len(run.t) == 0 or run.status is RunStatus.LIGHT_REACHED_ROD:
        return ""
    end, halt = float(run.t[-1]), reference.landmarks_beside().halting_time
    if halt is None:
        if own.halting_time is None or reference.landmarks_until(end).halting_time is None:
            return ""
        return f"the run ends at {end:.3f} s, when its string rests; the reference's rests then too, but slides again later"
    if end >= halt + MIN_REST:
        return ""
    rests = "" if own.halting_time is None else f"; its string rests from {own.halting_time:.3f} s to the end of the run"
    if end < halt:
        return f"the run ends at {end:.3f} s, before the reference halts at {halt:.3f} s{rests}"
    return f"the run ends at {end:.3f} s, less than {MIN_REST * 1e3:.0f} ms after the reference halts at {halt:.3f} s{rests}"

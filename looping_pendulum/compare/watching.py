"""Whether two runs were watched long enough to hold their halts against each other."""

from __future__ import annotations

from looping_pendulum.compare.landmarks import SampledReference
from looping_pendulum.compare.result import Landmarks
from looping_pendulum.compare.slides import MIN_REST
from looping_pendulum.engines.trajectory import RunStatus, Trajectory


def why_not_comparable(run: Trajectory, own: Landmarks, reference: SampledReference) -> str:
    """Return why the halt of ``run``, or its lack of one, says nothing beside the reference; empty: it does.

    A run that ended because its light mass reached the rod was watched to its end. One that was cut must have been watched for
    `MIN_REST` beyond the reference's halt to have it, too, or to refute it. Where it rests when it is cut, the reference must
    not rest then as well, only to slide again later.

    Parameters
    ----------
    own
        Landmarks of ``run``.
    """
    if len(run.t) == 0 or run.status is RunStatus.LIGHT_REACHED_ROD:
        return ""
    end, halt = float(run.t[-1]), reference.beside().halting_time
    if halt is None:
        if own.halting_time is None or reference.until(end).halting_time is None:
            return ""
        return f"the run ends at {end:.3f} s, while its string rests as the reference's does, which slides again later"
    if end >= halt + MIN_REST:
        return ""
    rests = "" if own.halting_time is None else f"; it rests from {own.halting_time:.3f} s on, as far as was seen"
    if end < halt:
        return f"the run ends at {end:.3f} s, before the reference halts at {halt:.3f} s{rests}"
    return f"the run ends at {end:.3f} s, less than {MIN_REST * 1e3:.0f} ms after the reference halts at {halt:.3f} s{rests}"

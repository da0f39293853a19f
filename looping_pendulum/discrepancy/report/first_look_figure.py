"""Interactive figure of a first look, for the page of a search that went on although something looked wrong."""

from __future__ import annotations

from typing import Any

from looping_pendulum.discrepancy.first_look import picture
from looping_pendulum.discrepancy.first_look.result import DeclarationCheck
from looping_pendulum.pages.figures import INK, Figure, escaped, plain, points


def figure(check: DeclarationCheck) -> Figure | None:
    """Return the points and the declared motion of the first trial with a mistake, or of the first one; None: there is none."""
    shown = picture.shown_trials(check)
    if not shown or shown[0].distance is None:
        return None
    curves = picture.curves(shown[0].distance)
    traces: list[dict[str, Any]] = []
    for i, curve in enumerate(curves):
        colour = f"var(--run-{i})"
        small = {"color": colour, "size": 5}
        traces.append(points(curve.label, plain(curve.points[:, 0]), plain(curve.points[:, 1]), colour, marker=small))
        motion = {"type": "scatter", "mode": "lines", "name": "declared motion", "showlegend": i == 0}
        line = {"line": {"color": INK, "width": 1.5}}
        traces.append(motion | line | {"x": plain(curve.motion[:, 0]), "y": plain(curve.motion[:, 1])})
    to_scale = {"scaleanchor": "x", "constrain": "domain"} if curves[0].is_path else {}
    x_title, y_title = picture.AXES[curves[0].is_path]
    return Figure(
        id="first-look",
        caption=f"First look, trial {escaped(shown[0].trial)}: tracked points of the first part, and the motion that the study "
        "declares, before anything is fitted.",
        traces=tuple(traces),
        layout={"xaxis": {"title": {"text": x_title}}, "yaxis": {"title": {"text": y_title}} | to_scale},
    )

"""What a figure shows, as plain data that can be stored and compared: a change of its look is then a choice."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

LONG = 12
"""Lists of more numbers than this are given by their number, ends and two sums."""

WITHIN = 1e-6
"""Relative difference of numbers that is rounding: figures show six digits at most."""

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def plain(value: Any) -> Any:
    """``value`` of dicts, sequences and numbers, with long lists of numbers shortened."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, str) or value is None or isinstance(value, bool):
        return value
    if isinstance(value, np.ndarray | Sequence):
        items = list(value)
        if len(items) > LONG and all(v is None or isinstance(v, int | float | np.number) for v in items):
            return _shortened([math.nan if v is None else float(v) for v in items])
        if len(items) > LONG and all(isinstance(v, list) and len(v) == 2 for v in items):
            return [plain(column) for column in zip(*items, strict=True)]
        return [plain(v) for v in items]
    if isinstance(value, int | float | np.number):
        return None if math.isnan(value) else round(float(value), 12)
    return str(value)


def _shortened(values: list[float]) -> dict[str, Any]:
    known = [(i, v) for i, v in enumerate(values) if math.isfinite(v)]
    ends = [v for _, v in (known[0], known[-1])] if known else []
    sums = [sum(v for _, v in known), sum(i * v for i, v in known)]
    return {"count": len(values), "known": len(known), "ends": ends, "sums": sums}


def of_figure(figure: Figure) -> dict[str, Any]:
    """Everything that one sees of a Matplotlib figure."""
    figure.draw_without_rendering()
    return plain(
        {
            "size": figure.get_size_inches(),
            "dpi": figure.dpi,
            "axes": [_of_axes(axes) for axes in figure.axes],
            "legends": [
                {
                    "words": [text.get_text() for text in legend.get_texts()],
                    "columns": legend._ncols,
                    "frame": legend.get_frame_on(),
                    "handle": legend.handlelength,
                }
                for legend in figure.legends
            ],
        }
    )


def _of_axes(axes: Any) -> dict[str, Any]:
    return {
        "title": axes.get_title(),
        "labels": [axes.get_xlabel(), axes.get_ylabel()],
        "scales": [axes.get_xscale(), axes.get_yscale()],
        "limits": [axes.get_xlim(), axes.get_ylim()],
        "aspect": axes.get_aspect(),
        "place": [round(x, 2) for x in axes.get_position().bounds],
        "x ticks": _ticks(axes.xaxis, axes.get_xlim()),
        "y ticks": _ticks(axes.yaxis, axes.get_ylim()),
        "grid": [_of_line(line) for line in axes.get_xgridlines()[:1]],
        "below": axes.get_axisbelow(),
        "lines": [_of_line(line) for line in axes.lines],
        "patches": [
            {"kind": type(p).__name__, "at": p.get_path().get_extents(p.get_patch_transform()).bounds, "z": p.zorder}
            | {"face": to_hex(p.get_facecolor(), keep_alpha=True), "edge": to_hex(p.get_edgecolor(), keep_alpha=True)}
            | {"lw": p.get_linewidth()}
            for p in axes.patches
        ],
        "collections": [_of_collection(c) for c in axes.collections],
        "texts": [
            {"text": t.get_text(), "at": t.get_position(), "rotation": t.get_rotation(), "size": t.get_fontsize()}
            | {"align": [t.get_ha(), t.get_va()], "colour": to_hex(t.get_color())}
            for t in axes.texts
        ],
    }


def _ticks(axis: Any, limits: tuple[float, float]) -> list[Any]:
    low, high = sorted(limits)
    labels = [text.get_text() for text in axis.get_ticklabels()]
    return [place for place in axis.get_ticklocs() if low <= place <= high] + [text for text in labels if text]


def _of_line(line: Any) -> dict[str, Any]:
    x, y = (np.asarray(v, dtype=float) for v in line.get_data())
    return {
        "label": line.get_label() if not str(line.get_label()).startswith("_") else "",
        "x": x, "y": y, "colour": to_hex(line.get_color()), "lw": line.get_linewidth(), "z": line.zorder,
        "dashes": line._dash_pattern, "marker": str(line.get_marker()), "ms": line.get_markersize(),
        "mew": line.get_markeredgewidth(), "mfc": to_hex(line.get_markerfacecolor()),
    }  # fmt: skip


def _of_collection(c: Any) -> dict[str, Any]:
    properties = {"kind": type(c).__name__, "z": c.zorder, "lw": c.get_linewidth(), "offsets": np.ravel(c.get_offsets())}
    properties |= {
        "colours": [to_hex(x, keep_alpha=True) for x in c.get_facecolor()],
        "edges": [to_hex(x) for x in c.get_edgecolor()],
    }
    if hasattr(c, "get_sizes"):
        return properties | {"sizes": c.get_sizes()}
    return properties | {"paths": [path.vertices.ravel() for path in c.get_paths()[:6]]}


def differences(actual: Any, stored: Any, where: str = "") -> list[str]:
    """Where the two are not the same, up to rounding."""
    if isinstance(stored, dict) and isinstance(actual, dict):
        keys = sorted(stored.keys() | actual.keys())
        return [d for k in keys for d in differences(actual.get(k, "nothing"), stored.get(k, "nothing"), f"{where}/{k}")]
    if isinstance(stored, list) and isinstance(actual, list) and len(stored) == len(actual):
        return [d for i, (a, b) in enumerate(zip(actual, stored, strict=True)) for d in differences(a, b, f"{where}/{i}")]
    if isinstance(stored, int | float) and isinstance(actual, int | float) and not isinstance(stored, bool):
        same = math.isclose(actual, stored, rel_tol=WITHIN, abs_tol=1e-9)
    else:
        same = actual == stored
    return [] if same else [f"{where}: found {actual}, stored {stored}"]

"""The looping-pendulum harness: an exact reference, physics engines beside it, and what a model of measured trials lacks.

``import looping_pendulum as lp`` has what a script or a notebook begins with; each module is imported when it is first used.
"""

from __future__ import annotations

import sys

# Nothing is imported here but what runs already: with `python -m` the working folder still comes first, see `__main__`
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from looping_pendulum.compare import write as write
    from looping_pendulum.compare.harness import compare_engines as compare_engines
    from looping_pendulum.discrepancy.identify import identify as identify
    from looping_pendulum.engines.registry import engine as engine
    from looping_pendulum.measured.film_points import track as track
    from looping_pendulum.measured.study_io import load as load_study  # noqa: F401
    from looping_pendulum.reference_ode.batch import solve_batch as solve_batch
    from looping_pendulum.reference_ode.solve import solve as solve
    from looping_pendulum.reference_ode.solve import solve_at as solve_at
    from looping_pendulum.runs.events import run_landmarks as landmarks  # noqa: F401
    from looping_pendulum.scenarios.loader import load as load
    from looping_pendulum.teaching.demo import write as write_demo  # noqa: F401

__version__ = "0.1.0"

_FROM = {
    "load": "scenarios.loader:load",
    "solve": "reference_ode.solve:solve",
    "solve_at": "reference_ode.solve:solve_at",
    "solve_batch": "reference_ode.batch:solve_batch",
    "engine": "engines.registry:engine",
    "landmarks": "runs.events:run_landmarks",
    "compare_engines": "compare.harness:compare_engines",
    "write": "compare:write",
    "write_demo": "teaching.demo:write",
    "track": "measured.film_points:track",
    "load_study": "measured.study_io:load",
    "identify": "discrepancy.identify:identify",
}
"""Name in this package -> where it stands. `compare` is the name of a package, so that the function has a longer one."""
__all__ = ["__version__", *_FROM]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562), so that the package itself costs no time."""
    import importlib

    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = _FROM[name].partition(":")
    return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *_FROM})


if "IPython" in sys.modules:
    from looping_pendulum.notebook import register

    register()

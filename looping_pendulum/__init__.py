"""The looping-pendulum harness: an exact reference, physics engines beside it, and what a model of measured trials lacks.

``import looping_pendulum as lp`` has what a script or a notebook begins with; each module is imported when it is first used.
"""

from __future__ import annotations

import sys

# Nothing is imported here but what runs already: with `python -m` the working folder still comes first, see `__main__`
TYPE_CHECKING = False
if TYPE_CHECKING:  # The same names as in `_FROM`, for type checkers and for completion without an interpreter
    from looping_pendulum.compare import write
    from looping_pendulum.compare.harness import compare_engines
    from looping_pendulum.discrepancy.fit_study import fit
    from looping_pendulum.discrepancy.identify import identify
    from looping_pendulum.discrepancy.report.figures import draw_all as figures
    from looping_pendulum.engines.registry import engine
    from looping_pendulum.measured.film_points import track
    from looping_pendulum.measured.study import Study, Trial
    from looping_pendulum.measured.study_io import load as load_study
    from looping_pendulum.reference_ode.batch import solve_batch
    from looping_pendulum.reference_ode.solve import solve, solve_at
    from looping_pendulum.runs.events import run_landmarks as landmarks
    from looping_pendulum.scenarios.loader import load
    from looping_pendulum.teaching.demo import write as write_demo

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
    "Study": "measured.study:Study",
    "Trial": "measured.study:Trial",
    "fit": "discrepancy.fit_study:fit",
    "identify": "discrepancy.identify:identify",
    "figures": "discrepancy.report.figures:draw_all",
}
"""Name in this package -> where it stands. `compare` is the name of a package, so that the function has a longer one."""
__all__ = [
    "__version__",
    "Study",
    "Trial",
    "compare_engines",
    "engine",
    "figures",
    "fit",
    "identify",
    "landmarks",
    "load",
    "load_study",
    "solve",
    "solve_at",
    "solve_batch",
    "track",
    "write",
    "write_demo",
]

if not TYPE_CHECKING:  # it would tell a type checker that every name is there

    def __getattr__(name):
        """Import what is asked for (PEP 562), so that the package itself costs no time."""
        import importlib

        if name not in _FROM:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, _, attribute = _FROM[name].partition(":")
        return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if "IPython" in sys.modules:
    from looping_pendulum.notebook import register

    register()

"""Machines and libraries that no result may depend on, made on one machine: what integrates, and how everything rounds.

`python -m tests.backends NAME -m pytest ...` runs Python under one of them, `make test BACKEND=NAME` the whole suite. A backend
is an environment that a process starts with, so that the processes which it starts in turn are under it too.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path

from numpy._core import _multiarray_umath as numpy_build

SITE = Path(__file__).with_name("site")
"""Folder of the `sitecustomize.py` that removes heyoka, or has it compile otherwise, in every process."""
NAME_VARIABLE = "LOOPING_PENDULUM_TEST_BACKEND"
HEYOKA_VARIABLE = "LOOPING_PENDULUM_TEST_HEYOKA"
"""JSON: what heyoka's compiler is asked for; null removes heyoka."""
DEFAULT = "heyoka"


def _dispatched() -> str:
    """Instruction sets that NumPy would use beyond those it was built for; it warns of names that this processor lacks."""
    names = (name for name in numpy_build.__cpu_dispatch__ if numpy_build.__cpu_features__[name])
    return os.environ.get("NPY_DISABLE_CPU_FEATURES") or " ".join(names)


OLD = {
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": _dispatched(),
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX2_Usable,-FMA,-FMA_Usable,-FMA4,-AVX",
}
"""Linear algebra, NumPy's functions and those of `math` without what x86 has learned since 2004: each then rounds otherwise."""


@dataclass(frozen=True, kw_only=True)
class Backend:
    """What a process under it finds."""

    heyoka: str = "{}"
    """Value of `HEYOKA_VARIABLE`."""
    environment: dict[str, str] = field(default_factory=dict)
    why: str


BACKENDS = {
    DEFAULT: Backend(
        environment={"PYTHONHASHSEED": "0"}, why="as installed; what heyoka compiles for the tests themselves is not optimised"
    ),
    "heyoka-optimised": Backend(environment={"PYTHONHASHSEED": "0"}, why="as installed, optimised for the tests too"),
    "heyoka-avx512": Backend(
        heyoka='{"force_avx512": true, "slp_vectorize": true}',
        why="vectors of eight numbers, and sums in another order; without AVX-512 only the latter",
    ),
    "heyoka-no-fma": Backend(
        heyoka='{"opt_level": 0}', why="nothing optimised, and every product rounded: no fused multiply-add"
    ),
    "scipy": Backend(heyoka="null", why="heyoka is not installed, as on any machine but Linux on x86-64"),
    "old-processor": Backend(
        heyoka='{"opt_level": 0}', environment=OLD | {"PYTHONHASHSEED": "1"}, why="no AVX and no fused multiply-add anywhere"
    ),
    "old-processor-scipy": Backend(heyoka="null", environment=OLD | {"PYTHONHASHSEED": "2"}, why="the same without heyoka"),
}


def current() -> str:
    """Name of this process's backend."""
    return os.environ.get(NAME_VARIABLE, DEFAULT)


def environment(name: str) -> dict[str, str]:
    """Return this process's environment as it is under the backend ``name``."""
    backend = BACKENDS[name]
    set_by_any = {variable for other in BACKENDS.values() for variable in other.environment}
    others = {variable: value for variable, value in os.environ.items() if variable not in set_by_any}
    paths = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path and path != str(SITE)]
    return others | {
        **backend.environment,
        NAME_VARIABLE: name,
        HEYOKA_VARIABLE: backend.heyoka,
        "PYTHONPATH": os.pathsep.join([str(SITE), *paths]),
    }

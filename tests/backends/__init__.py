"""Machines that no result may depend on, made on one machine: how everything rounds that the core does not compute.

`python -m tests.backends NAME -m pytest ...` runs Python under one of them, `make test BACKEND=NAME` the whole suite. A backend
is an environment that a process starts with, so that the processes which it starts in turn are under it too.
"""

import os
from dataclasses import dataclass

from numpy._core import _multiarray_umath as numpy_build

NAME_VARIABLE = "LOOPING_PENDULUM_TEST_BACKEND"
DEFAULT = "here"


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

    environment: dict[str, str]
    why: str


BACKENDS = {
    DEFAULT: Backend(environment={"PYTHONHASHSEED": "0"}, why="as installed"),
    "old-processor": Backend(environment=OLD | {"PYTHONHASHSEED": "1"}, why="no AVX and no fused multiply-add anywhere"),
}


def current() -> str:
    """Name of this process's backend."""
    return os.environ.get(NAME_VARIABLE, DEFAULT)


def environment(name: str) -> dict[str, str]:
    """Return this process's environment as it is under the backend ``name``."""
    set_by_any = {variable for other in BACKENDS.values() for variable in other.environment}
    others = {variable: value for variable, value in os.environ.items() if variable not in set_by_any}
    return others | BACKENDS[name].environment | {NAME_VARIABLE: name}

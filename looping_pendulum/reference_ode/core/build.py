"""Compiles the driver: ``python -m looping_pendulum.reference_ode.core.build`` writes `stages.h` and `driver.wasm` anew.

Only whoever changes `driver.c` needs this, and the compiler, which the extra ``test`` brings as the wheel ``ziglang``. A test
holds that the files in the repository are what it writes.
"""

from __future__ import annotations

import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

EXPORTS = (
    "room", "release_room", "begin", "advance", "w_exp", "w_log", "w_sin", "w_cos", "w_tanh",
)  # fmt: skip
OPTIONS = (
    "--target=wasm32-wasi", "-mexec-model=reactor", "-O3", "-msimd128", "-mbulk-memory",
    # A product and a sum are rounded each, as everywhere
    "-ffp-contract=off", "-fvisibility=hidden", "-Wall", "-Wextra", "-Werror",
    "-Wl,--export-table", "-Wl,--growable-table", "-Wl,--strip-all", *(f"-Wl,--export={name}" for name in EXPORTS),
)  # fmt: skip


def main() -> None:
    """Write both files into the package."""
    here = Path(str(files("looping_pendulum.reference_ode.core")))
    (here / "stages.h").write_text(stages(), encoding="utf-8")
    compile_driver(here, here / "driver.wasm")


def compile_driver(folder: Path, target: Path) -> None:
    """Compile the sources in ``folder``."""
    command = [sys.executable, "-m", "ziglang", "cc", *OPTIONS, "-o", str(target), "driver.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)


def stages() -> str:
    """Return DOP853 as straight C code, from SciPy's tables of its coefficients."""
    from scipy.integrate._ivp import dop853_coefficients as tables

    def stage(s: int) -> list[str]:
        return [
            f"  for (int i = 0; i < N; i++) ZS[i] = Z[i] + h * ({_sum(tables.A[s])});",
            f"  rates(t + {float(tables.C[s])!r} * h, ZS, K[{s}]);",
        ]

    lines = [
        "// Written by build.py from SciPy's coefficients of the method of Dormand and Prince of order 8.",
        "static void attempt(double t, double h) {",
        *(line for s in range(1, 12) for line in stage(s)),
        f"  for (int i = 0; i < N; i++) ZN[i] = Z[i] + h * ({_sum(tables.B)});",
        "  rates(t + h, ZN, K[12]);",
        "}",
        f"static double err5(int i) {{ return {_sum(tables.E5)}; }}",
        f"static double err3(int i) {{ return {_sum(tables.E3)}; }}",
        "static void complete(double t, double h) {",
        *(line for s in range(13, 16) for line in stage(s)),
        "  for (int i = 0; i < N; i++) {",
        "    const double change = ZN[i] - Z[i];",
        "    D[0][i] = change, D[1][i] = h * K[0][i] - change, D[2][i] = 2 * change - h * (K[12][i] + K[0][i]);",
        *(f"    D[{3 + k}][i] = h * ({_sum(row)});" for k, row in enumerate(tables.D)),
        "  }",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _sum(row: Any) -> str:
    return " + ".join(f"{float(value)!r} * K[{j}][i]" for j, value in enumerate(row) if value != 0)


if __name__ == "__main__":
    main()

"""How much memory a process holds, and amounts of memory with their unit: "2 GiB" to bytes and back."""

from __future__ import annotations

import functools
import subprocess
import sys
from pathlib import Path
from typing import Any

from looping_pendulum.errors import EngineError

DEFINITIONS = """
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
kibi- = 1024 = Ki-
mebi- = 1048576 = Mi-
gibi- = 1073741824 = Gi-
byte = [memory] = B
"""
"""Units of memory, for pint."""

MEMORY_LIMIT = 2 * 1024**3
"""Default limit on the memory of one run [bytes]; our adapters were measured to hold 35 to 141 MiB."""

SMALLEST_LIMIT = 64 * 1024**2
"""[bytes] Python with NumPy alone takes more than half of this."""

POLL_INTERVAL = 0.05 if sys.platform.startswith("linux") else 0.5
"""Time between two looks at a process's memory [s]; without /proc each look starts `ps`."""


def held_memory(pid: int) -> int | None:
    """Memory that a process holds, in RAM and swapped out [bytes]; None if it is gone or this system does not say.

    Linux tells it in /proc. Elsewhere `ps` gives the part in RAM; where there is no `ps` (Windows) nothing is known.
    """
    if sys.platform.startswith("linux"):
        try:
            lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        except OSError:
            return None
        held = [int(line.split()[1]) for line in lines if line.startswith(("VmRSS:", "VmSwap:"))]
    else:
        try:
            done = subprocess.run(["ps", "-o", "rss=", "-p", str(pid)], capture_output=True, text=True, timeout=5, check=False)
        except (OSError, subprocess.TimeoutExpired):
            return None
        held = [int(number) for number in done.stdout.split() if number.isdigit()]
    return 1024 * sum(held) if held else None


def parse_memory(text: str) -> int:
    """Bytes of a text such as "2 GiB".

    Raises
    ------
    EngineError
        If it is no amount of memory, or less than `SMALLEST_LIMIT`.
    """
    import pint

    try:
        quantity = _registry().Quantity(text)
        amount = float(quantity.to("byte").magnitude)
        whole = int(amount)
    except (pint.PintError, ArithmeticError, AttributeError, AssertionError, SyntaxError, TypeError, ValueError):
        raise EngineError(f"--memory-limit: found {text!r}, needed an amount of memory; write for example '2 GiB'") from None
    if whole < SMALLEST_LIMIT:
        raise EngineError(
            f"--memory-limit: found {text!r}, needed {show_memory(SMALLEST_LIMIT)} or more: Python with NumPy takes half"
        )
    return whole


def show_memory(amount: int) -> str:
    """Write ``amount`` [bytes] with a handy unit: "2 GiB", "512 MiB"."""
    return f"{amount / 1024**3:.3g} GiB" if amount >= 1024**3 else f"{amount / 1024**2:.3g} MiB"


@functools.cache
def _registry() -> Any:
    """Return the unit registry; pint is imported on use."""
    import pint

    registry: Any = pint.UnitRegistry(None)
    registry.load_definitions(DEFINITIONS.strip().splitlines())
    return registry

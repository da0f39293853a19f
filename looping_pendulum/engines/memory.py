"""How much memory a process holds, and amounts of memory with their unit: "2 GiB" to bytes and back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from looping_pendulum.errors import EngineError, one_line
from looping_pendulum.pages.numbers import number
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import UnitError, to_si

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
    try:
        whole = int(to_si(text, "byte"))
    except UnitError:
        message = f"--memory-limit: found {quote(text)}, needed an amount of memory; write for example '2 GiB'"
        raise EngineError(one_line(message)) from None
    if whole < SMALLEST_LIMIT:
        least = show_memory(SMALLEST_LIMIT)
        message = f"--memory-limit: found {quote(text)}, needed {least} or more: Python with NumPy takes half"
        raise EngineError(one_line(message))
    return whole


def show_memory(amount: int) -> str:
    """Write ``amount`` [bytes] with a handy unit: "2 GiB", "512 MiB"."""
    return f"{number(amount / 1024**3)} GiB" if amount >= 1024**3 else f"{number(amount / 1024**2)} MiB"

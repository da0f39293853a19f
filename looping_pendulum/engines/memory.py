"""Measure how much memory a process uses, and convert amounts of memory: "2 GiB" to bytes and back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from looping_pendulum.errors import EngineError, one_line
from looping_pendulum.pages.numbers import number
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import UnitError, to_si

MEMORY_LIMIT = 2 * 1024**3
"""Default limit on the memory of one run [bytes]; runs of the shipped adapters were measured to take 35 to 141 MiB."""

MIN_MEMORY_LIMIT = 64 * 1024**2
"""Smallest memory limit that is accepted [bytes]; Python with NumPy alone takes more than half of it."""

POLL_INTERVAL = 0.05 if sys.platform.startswith("linux") else 0.5
"""Time between two measurements of a process's memory [s]; without /proc each one has to start `ps`."""


def memory_in_use(pid: int) -> int | None:
    """Return the memory of a process, in RAM and swapped out [bytes]; None if it has ended or this system does not report it.

    Linux reports both in /proc. Elsewhere `ps` gives the part in RAM only; where there is no `ps` (Windows) nothing is known.
    """
    if sys.platform.startswith("linux"):
        try:
            lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        except OSError:
            return None
        kibibytes = [int(line.split()[1]) for line in lines if line.startswith(("VmRSS:", "VmSwap:"))]
    else:
        try:
            ps = subprocess.run(["ps", "-o", "rss=", "-p", str(pid)], capture_output=True, text=True, timeout=5, check=False)
        except (OSError, subprocess.TimeoutExpired):
            return None
        kibibytes = [int(number) for number in ps.stdout.split() if number.isdigit()]
    return 1024 * sum(kibibytes) if kibibytes else None


def parse_memory(text: str) -> int:
    """Return the number of bytes of a text such as "2 GiB".

    Raises
    ------
    EngineError
        If it is no amount of memory, or less than `MIN_MEMORY_LIMIT`.
    """
    try:
        size = int(to_si(text, "byte"))
    except UnitError:
        message = f"--memory-limit: found {quote(text)}, needed an amount of memory; write for example '2 GiB'"
        raise EngineError(one_line(message)) from None
    if size < MIN_MEMORY_LIMIT:
        minimum = format_memory(MIN_MEMORY_LIMIT)
        message = f"--memory-limit: found {quote(text)}, needed {minimum} or more: Python with NumPy takes half"
        raise EngineError(one_line(message))
    return size


def format_memory(amount: int) -> str:
    """Write ``amount`` [bytes] in MiB or GiB: "2 GiB", "512 MiB"."""
    return f"{number(amount / 1024**3)} GiB" if amount >= 1024**3 else f"{number(amount / 1024**2)} MiB"

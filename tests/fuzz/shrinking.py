"""Make an input smaller for as long as it stays the same fault."""

import re
import time
from collections.abc import Callable, Sequence

_LINES = re.compile(rb"[^\n\0]*(?:[\n\0]|\Z)")
_TOKENS = re.compile(rb"\w+|\s+|.", re.DOTALL)


def shrink(data: bytes, is_same_fault: Callable[[bytes], bool], *, seconds: float = 20.0) -> bytes:
    """Return the smallest input found by leaving out lines, then words, then bytes, until none can go or time is up."""
    end = time.monotonic() + seconds
    size = -1
    while size != len(data) and time.monotonic() < end:
        size = len(data)
        for split in (_LINES.findall, _TOKENS.findall, lambda text: [text[i : i + 1] for i in range(len(text))]):
            data = b"".join(_without_needless(split(data), is_same_fault, end))
    return data


def _without_needless(parts: Sequence[bytes], is_same_fault: Callable[[bytes], bool], end: float) -> Sequence[bytes]:
    """Leave out ever smaller runs of parts."""
    run = len(parts)
    while run and time.monotonic() < end:
        start = 0
        while start < len(parts) and time.monotonic() < end:
            fewer = [*parts[:start], *parts[start + run :]]
            if is_same_fault(b"".join(fewer)):
                parts = fewer
            else:
                start += run
        run //= 2
    return parts

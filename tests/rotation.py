"""Long tests take turns: each run of the whole suite has one share of them, and all have run after `SHARES` days.

`python -m tests.rotation LOG` lists them anew, from the output of a run with `--durations=0 --rotation all`.
"""

import datetime
import re
import sys
import zlib
from collections import Counter
from functools import cache
from pathlib import Path

SHARES = 6
"""Number of shares; a share's number is that of the day."""
LIST = Path(__file__).with_name("long_tests.txt")
LONG = 0.7
"""Duration of a long test on an idle machine of two cores, its fixtures included [s]."""
_DURATION = re.compile(r"([\d.]+)s (?:call|setup|teardown) +(\S.*?) *$")


def today() -> int:
    """Return the number of today's share."""
    return datetime.date.today().toordinal() % SHARES


def is_due(name: str, share: int) -> bool:
    """Return whether a test, by its name with its file, is in a share or in none."""
    return name not in _long_tests() or zlib.crc32(name.encode()) % SHARES == share


@cache
def _long_tests() -> frozenset[str]:
    return frozenset(LIST.read_text(encoding="utf-8").splitlines())


def main(log: str, scale: float = 1.0) -> None:
    """Write the list; ``scale``: duration on an idle machine, in that of the log."""
    durations = Counter[str]()
    for line in Path(log).read_text(encoding="utf-8").splitlines():
        if found := _DURATION.fullmatch(line):
            durations[found[2]] += float(found[1])
    long = sorted(name for name, seconds in durations.items() if scale * seconds >= LONG)
    LIST.write_text("".join(f"{name}\n" for name in long), encoding="utf-8")
    total, in_turn = sum(durations.values()), sum(durations[name] for name in long)
    print(f"{len(long)} tests take turns, {scale * in_turn:.0f} s of {scale * total:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:3]))

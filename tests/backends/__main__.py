"""Run Python under a backend: `python -m tests.backends old-processor -m pytest tests/compare`."""

import os
import sys

from tests.backends import BACKENDS, environment

if __name__ == "__main__":
    if len(sys.argv) < 3 or sys.argv[1] not in BACKENDS:
        listed = "\n".join(f"  {name:20} {backend.why}" for name, backend in BACKENDS.items())
        sys.exit(f"usage: python -m tests.backends NAME -m pytest ...; names:\n{listed}")
    os.execve(sys.executable, [sys.executable, *sys.argv[2:]], environment(sys.argv[1]))

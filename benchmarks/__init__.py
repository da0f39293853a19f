"""How long users wait; `python -m benchmarks --help`."""

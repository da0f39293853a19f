"""Damaged and hostile inputs, by the thousand: ``python -m tests.fuzz``.

Each input is a real file, quantity or command line that a seeded generator has damaged. It must be accepted, or refused by one
of the package's own errors. Anything else is a fault: another exception, a warning, or no end within the time limit.
"""

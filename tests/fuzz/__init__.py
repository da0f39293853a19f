"""Damaged and hostile inputs: each is a real file, quantity or command line that Hypothesis has damaged.

It must be accepted, or refused by one of the package's own errors, in one line. Anything else is a fault: another exception, a
warning, or no end within the time limit. `make fuzz` tries thousands.
"""

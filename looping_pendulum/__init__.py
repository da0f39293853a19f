"""The looping-pendulum harness: an exact reference, three physics engines, and what sets them apart."""

__version__ = "0.1.0"

"""The looping-pendulum harness: an exact reference, three physics engines, and what sets them apart."""

import sys

__version__ = "0.1.0"

if "IPython" in sys.modules:
    from looping_pendulum.notebook import register

    register()

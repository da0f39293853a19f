"""Run the command line as `python -m looping_pendulum`."""

import os
import sys

_HERE = os.path.realpath(os.getcwd())
if not sys.flags.safe_path and sys.path and os.path.realpath(sys.path[0]) == _HERE:
    del sys.path[0]  # `-m` has put the working folder there: a student's file beside a scenario is never imported
    if os.path.realpath(os.path.dirname(os.path.dirname(__file__))) == _HERE:
        sys.path.append(_HERE)  # this package itself is there, not installed: last, so that it shadows nothing

from looping_pendulum.cli.main import main  # noqa: E402

main()

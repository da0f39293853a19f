"""The command line in the test's own process: its exit status and all that it prints, without a new process's imports."""

import contextlib
import io
import os
import signal
import sys
import warnings
from dataclasses import dataclass
from unittest import mock

from looping_pendulum.cli.main import main


@dataclass(frozen=True, kw_only=True)
class Done:
    """How a command ended; named as of `subprocess.CompletedProcess`."""

    returncode: int
    stdout: str
    stderr: str


def here(*arguments: str) -> Done:
    """Run a command as its user does, to the exit status; a warning is shown and not raised."""

    def show(message, category, filename, lineno, file=None, line=None):
        sys.stderr.write(warnings.formatwarning(message, category, filename, lineno, line))

    code: object = None
    with (
        mock.patch.object(sys, "argv", ["looping-pendulum", *arguments]),
        mock.patch.dict(os.environ, COLUMNS="200"),
        mock.patch.object(warnings, "formatwarning", warnings.formatwarning),
        warnings.catch_warnings(),
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
    ):
        warnings.simplefilter("default")
        warnings.showwarning = show
        try:
            main()
        except SystemExit as ended:
            code = ended.code
    assert code is None or isinstance(code, int)
    return Done(returncode=code or 0, stdout=out.getvalue(), stderr=err.getvalue())


def can_be_interrupted() -> None:
    """Let a process be interrupted, as ``preexec_fn``: below a shell's background job it would ignore SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)

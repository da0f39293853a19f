"""Follow what the errors of a file advise, as its owner would."""

import re
import shlex

import yaml
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.measured.tables.readers import DataError, read
from looping_pendulum.scenarios.units import to_si

MAX_STEPS = 3
"""Largest number of advices after which a file is read, or must be exported otherwise."""


def _read_or_refuse(path, options):
    try:
        return read(path, **options)
    except DataError as error:
        return error


def follow_advice(path, **options):
    """Return the observations of a file, or None if the last advice names another export, and everything that was advised.

    Raises
    ------
    AssertionError
        If an advice comes again, leads nowhere, or too many follow.
    """
    said = []
    while isinstance(result := _read_or_refuse(path, options), DataError):
        message, way_out = str(result), result.way_out
        assert message not in said, f"comes again: {message}"
        said.append(message)
        assert len(said) <= MAX_STEPS, said
        if way_out is None:
            assert re.search(r"\bexport|such as '.*'; add it", message), said
            return None, said
        keys = {}
        for key, value in way_out.keys.items():
            group, _, name = key.partition(".")
            keys[group] = keys.get(group, {}) | {name: value} if name else value
        if not way_out.is_example:
            # As the study's author types it; values that are examples stand in no message
            typed = re.findall(r"'(\w+: .*?)'(?= and '|; |$)", message.removeprefix(result.problem))
            assert yaml.load("\n".join(typed), yaml.BaseLoader) == keys, said
        for key, value in keys.items():
            value = to_si(value, "1/s") if key == "frame_rate" else value
            options[key] = (options.get(key) or {}) | value if key == "units" else value
    return result, said


def follow_advice_of_look(path):
    """Type `look TABLE`, and again with the options that it advises; return all that it said.

    Raises
    ------
    AssertionError
        If an advice comes again, leads nowhere, or too many follow.
    """
    said, options = [], []
    while True:
        done = CliRunner().invoke(app, ["look", str(path), *options])
        if done.exit_code == 0:
            return [*said, done.output]
        message = str(done.exception)
        assert isinstance(done.exception, DataError), message
        assert message not in said, f"comes again: {message}"
        said.append(message)
        assert len(said) <= MAX_STEPS, said
        # The first of two ways out
        typed = shlex.split(" ".join(re.findall(r"--set (?:'[^']*'|\S+)", message.split("; if times count")[0])))
        if not typed:
            assert re.search(r"\bexport|such as '.*'; add it|name the column", message), said
            return said
        options += typed

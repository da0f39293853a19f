"""Writes what was measured of a variant into its engine's facts."""

import json
import re
from collections.abc import Sequence
from typing import Any

from looping_pendulum.engines.facts import facts_path
from looping_pendulum.files import write_atomically

LONGEST_LINE = 110
"""Longest line to which a list or an object is joined in a file of facts."""


def write_measured(label: str, key: str, rows: Sequence[Any]) -> None:
    """Replace the ``key``, "measured" or "additions", of the variant ``label``, "mujoco:beads", in its engine's facts."""
    engine, _, variant = label.partition(":")
    path = facts_path(engine)
    tree = json.loads(path.read_text(encoding="utf-8"))
    tree["variants"][variant][key] = rows
    # A short list or object, which holds no other, is a line
    text = re.sub(r"[\[{][^\[\]{}]*[\]}]", _joined, json.dumps(tree, indent=1))
    write_atomically(path, text + "\n")


def _joined(match: re.Match[str]) -> str:
    """Return a list or an object of several lines as one line, unless that is too long."""
    line = " ".join(match[0].split())
    line = line[0] + line[1:-1].strip() + line[-1]
    return line if len(line) <= LONGEST_LINE else match[0]

"""The worked example of docs/write-an-engine.md, taken from the page."""

from __future__ import annotations

import re
import sys
import types
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "write-an-engine.md"


def blocks(language):
    """Return the code blocks of one language, in the order of the page."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def module(name, source):
    """Make a module of ``source``, importable by ``name``, so that its classes can be pickled."""
    made = types.ModuleType(name)
    sys.modules[name] = made
    exec(compile(source, f"{PAGE.name}: {name}", "exec"), made.__dict__)
    return made

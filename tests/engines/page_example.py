"""The worked example of docs/write-an-engine.md, taken from the page."""

import sys
import types

from tests import page_package
from tests.docs_commands import PROJECT

PAGE = PROJECT / "docs" / "write-an-engine.md"


def blocks(language):
    """Return the code blocks of one language, in the order of the page."""
    return page_package.blocks(PAGE, language)


def module(name, source):
    """Make a module of ``source``, importable by ``name``, so that its classes can be pickled."""
    made = types.ModuleType(name)
    sys.modules[name] = made
    exec(compile(source, f"{PAGE.name}: {name}", "exec"), made.__dict__)
    return made

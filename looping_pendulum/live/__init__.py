"""The exact model in plain JavaScript, for a page in which a reader sets the apparatus and sees its run at once.

`model.js` is written by `generate` from `reference_ode`, so that no equation stands twice; the method of integration, the
search for events and the loop over the modes (`integrator.js`, `events.js`, `run.js`) follow `scipy_backend` and `driver`.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

MODULES = ("model.js", "integrator.js", "events.js", "run.js")
"""Modules of the model, each after those that it imports."""
EXPORTS = ("simulate", "DEFAULTS", "REQUIRED", "PHASE_EVENTS")
"""Names that a page can read; `simulate` is described in `run.js`."""


@cache
def page_script() -> str:
    """Return the modules as one script without imports, for a page: ``loopingPendulum.simulate(settings, {duration})``."""
    texts = [(files(__package__) / module).read_text(encoding="utf-8") for module in MODULES]
    bodies = [re.sub(r"^export ", "", re.sub(r"^import [^;]*;\n", "", text, flags=re.M), flags=re.M) for text in texts]
    return "const loopingPendulum = (() => {\n" + "\n".join(bodies) + f"return {{ {', '.join(EXPORTS)} }};\n}})();\n"

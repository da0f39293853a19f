"""Joins JavaScript modules into one script, as a page that opens from a file can import no other files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from posixpath import dirname, join, normpath

from rjsmin import jsmin

PACKAGE = "looping_pendulum.live"
_IMPORT = re.compile(r"^import \{([^}]*)\} from \"(\.[^\"]+)\";\n", re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:const|let|class|function)\b)", re.MULTILINE)
_NAME = re.compile(r"^export (?:async )?(?:const|let|class|function\*?) (\w+)", re.MULTILINE)
_NAMES_OF_OTHERS = re.compile(r"^export \{([^}]*)\};\n", re.MULTILINE)
_OTHER_FORM = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)
_NESTED_TEMPLATE = re.compile(r"`[^`]*\$\{[^}`]*`")


def bundle(entry: str) -> str:
    """Return one script that runs the module ``entry`` and all that it imports, each in a function of its own, minified.

    Parameters
    ----------
    entry
        Path of the module below the package, "assets/main.js".

    Raises
    ------
    ValueError
        If a module imports or exports in a form other than by names, or modules import one another in a circle.
    """
    modules: dict[str, str] = {}
    _add(entry, modules, ())
    return jsmin("\n".join(['"use strict";', *(_wrapped(path, source) for path, source in modules.items())]))


@cache
def page_script() -> str:
    """Return the model as one script, for a page: ``loopingPendulum.simulate(settings, {duration})``.

    ``loopingPendulum`` has what `run.js` and `model.js` export.
    """
    return bundle("run.js") + "\nconst loopingPendulum = { ...module_model, ...module_run };\n"


def _add(path: str, modules: dict[str, str], importers: tuple[str, ...]) -> None:
    """Add a module after those that it imports."""
    if path in importers:
        raise ValueError(f"{path}: found a circle of imports: {' -> '.join((*importers, path))}")
    if path in modules:
        return
    source = files(PACKAGE).joinpath(path).read_text(encoding="utf-8")
    for imported in _IMPORT.finditer(source):
        _add(_resolved(path, imported[2]), modules, (*importers, path))
    modules[path] = source


def _resolved(path: str, imported: str) -> str:
    return normpath(join(dirname(path), imported))


def _wrapped(path: str, source: str) -> str:
    """Return a module as a function whose result has what it exports."""
    if nested := _NESTED_TEMPLATE.search(source):
        raise ValueError(f"{path}: found {nested[0]!r}, needed no template within a template, which rjsmin does not tell apart")
    exported = [*_NAME.findall(source), *(name for names in _NAMES_OF_OTHERS.findall(source) for name in _names(names))]
    body = _IMPORT.sub(lambda m: f"const {{ {', '.join(_names(m[1]))} }} = {_variable(_resolved(path, m[2]))};\n", source)
    body = _EXPORT.sub("", _NAMES_OF_OTHERS.sub("", body))
    if other := _OTHER_FORM.search(body):
        raise ValueError(f"{path}: found {other[0]!r}, needed imports and exports by names")
    return f"const {_variable(path)} = (() => {{\n{body}return {{ {', '.join(exported)} }};\n}})();"


def _names(listed: str) -> Iterator[str]:
    return (name for part in listed.split(",") if (name := part.strip()))


def _variable(path: str) -> str:
    return "module_" + re.sub(r"\W", "_", path.removesuffix(".js"))

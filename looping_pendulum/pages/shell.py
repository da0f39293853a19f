"""Builds one self-contained HTML file from a template, styles, scripts and data."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

from jinja2 import PackageLoader, Template
from markupsafe import Markup
from rcssmin import cssmin

from looping_pendulum.pages.palette import colour_rules
from looping_pendulum.pages.templates import templates

SHARED_PACKAGE = "looping_pendulum.pages"
"""Package whose ``assets`` folder holds the files that all pages share."""


@cache
def asset(package: str, name: str) -> str:
    """Return the text of a file in the folder ``assets`` of ``package``."""
    return files(package).joinpath("assets", name).read_text(encoding="utf-8")


def embedded(data: Any) -> str:
    """Return ``data`` as JSON that is safe inside a script element: no text in it can end the element or open another."""
    # NaN is no JSON: a browser would refuse the whole page's data, so it is refused here
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def page(
    package: str,
    template: str,
    *,
    title: str,
    styles: Sequence[tuple[str, str]] = (),
    scripts: Sequence[str] = (),
    webassembly: bool = False,
    data: Mapping[str, Any] | None = None,
    **context: Any,
) -> str:
    """Render ``template`` of ``package``'s assets, which extends the shared ``base.html``.

    Parameters
    ----------
    styles
        (package, file) of style sheets in addition to the shared one.
    scripts
        Sources of scripts, run in this order at the end of the body. Nothing else can run, since the security policy
        lists them by hash.
    webassembly
        Whether scripts may run WebAssembly, and start workers whose text they have themselves.
    data
        Id of an element -> data that scripts read from it as JSON.
    context
        Variables of the template; text is escaped.
    """
    theme = asset(SHARED_PACKAGE, "theme.js")
    sheets = [asset(SHARED_PACKAGE, "base.css"), colour_rules(), *(asset(*sheet) for sheet in styles)]
    return _compiled(package, template).render(
        title=title,
        policy=Markup(_policy([theme, *scripts], webassembly=webassembly)),
        sheet=Markup(cssmin("\n".join(sheets))),
        theme=Markup(theme),
        scripts=[Markup(_checked_script(source)) for source in scripts],
        data={name: Markup(embedded(value)) for name, value in (data or {}).items()},
        **context,
    )


@cache
def _compiled(package: str, template: str) -> Template:
    loaders = (PackageLoader(each, "assets") for each in (package, SHARED_PACKAGE))
    return templates(*loaders).get_template(template)


@lru_cache(maxsize=8)  # plotly.js, which every report embeds, has megabytes
def _checked_script(source: str) -> str:
    """Return ``source`` after checking that it cannot end its own script element."""
    if "</script" in source.lower() or "<!--" in source:
        raise ValueError(
            "a page's script holds '</script' or '<!--', which would end its element early; split that string in two"
        )
    return source


def _policy(scripts: Sequence[str], *, webassembly: bool) -> str:
    """Return the content security policy: no requests at all, and only ``scripts`` may run."""
    run = " ".join(f"'sha256-{_digest(source)}'" for source in scripts)
    more = " 'wasm-unsafe-eval'; worker-src blob:; media-src blob:" if webassembly else ""
    return f"default-src 'none'; style-src 'unsafe-inline'; img-src data: blob:; script-src {run}{more}"


@lru_cache(maxsize=8)
def _digest(source: str) -> str:
    return base64.b64encode(hashlib.sha256(source.encode()).digest()).decode()

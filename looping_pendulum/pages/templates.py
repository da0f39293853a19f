"""Jinja2 environments: of pages in HTML and of reports in Markdown. Both escape what a template shows."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from looping_pendulum.pages import markdown
from looping_pendulum.pages.numbers import GAP, fixed, number, quantity, signed


def html_templates(load: Callable[[str], str], **options: Any) -> Environment:
    """Return an environment whose templates ``load`` returns by name; values are escaped as HTML."""
    # StrictUndefined: a misspelt variable is an error, not an empty place on the page
    return Environment(
        loader=FunctionLoader(load),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        **options,
    )


def markdown_templates(package: str) -> Environment:
    """Return an environment of the templates in the folder of ``package``; values are escaped as Markdown (`escaped`).

    Values that are Markdown, such as a table, are given as `Markup`.
    """
    environment = html_templates(
        lambda name: files(package).joinpath(name).read_text(encoding="utf-8"), finalize=markdown.escaped
    )
    environment.filters |= {
        "code": markdown.code,
        "escaped_lines": markdown.escaped_lines,
        "fixed": fixed,
        "number": number,
        "quantity": quantity,
        "signed": signed,
        "yes": lambda value: "yes" if value else "no",
    }
    environment.globals |= {"GAP": GAP, "table": lambda *rows, **layout: Markup(markdown.table(*rows, **layout))}
    return environment


def sections(environment: Environment, template: str, **context: Any) -> list[str]:
    """Return the sections of a report in Markdown, each with its heading first; what stands before the first is one, too."""
    text = re.sub(r"\n{3,}", "\n\n", environment.get_template(template).render(**context))
    return [part.strip("\n") + "\n" for part in re.split(r"^(?=## )", text, flags=re.MULTILINE) if part.strip()]

"""Jinja2 environments: of pages in HTML and of reports in Markdown, which escape what a template shows, and of plain text."""

from __future__ import annotations

import re
from typing import Any

from jinja2 import BaseLoader, ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from looping_pendulum.pages import markdown
from looping_pendulum.pages.numbers import GAP, fixed, number, quantity, signed


def templates(*loaders: BaseLoader, autoescape: bool = True, **options: Any) -> Environment:
    """Return an environment of the templates that one of ``loaders`` has; values are escaped as HTML if ``autoescape``."""
    # StrictUndefined: a misspelt variable is an error, not an empty place on the page
    return Environment(
        loader=ChoiceLoader(loaders),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        **options,
    )


def markdown_templates(package: str) -> Environment:
    """Return an environment of the templates in the folder of ``package``; values are escaped as Markdown (`escaped`).

    Values that are Markdown, such as a table, are given as `Markup`.
    """
    environment = templates(PackageLoader(package, ""), finalize=markdown.escaped)
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

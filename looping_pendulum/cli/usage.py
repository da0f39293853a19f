"""The help of commands: usage as people type it, in whatever way the installed typer would write it, and -h beside --help."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import typer
import typer.core

HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}


class Command(typer.core.TyperCommand):
    """A command whose arguments stand in its help by their metavars alone: "SCENARIO", "[NAME ...]"."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words of the usage line behind the command's name."""
        return ["[OPTIONS]", *(argument.metavar for argument in self._arguments(ctx))]

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the help, with each example on one line, so that it can be pasted."""
        for paragraph in inspect.cleandoc(self.help or "").split("\n\n"):
            formatter.write_paragraph()
            with formatter.indentation():
                if "looping-pendulum " in paragraph:
                    formatter.write("".join(f"{' ' * formatter.current_indent}{line}\n" for line in paragraph.splitlines()))
                else:
                    formatter.write_text(paragraph)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        arguments = [(argument.metavar, argument.help or "") for argument in self._arguments(ctx)]
        options = [each.get_help_record(ctx) for each in self.get_params(ctx) if each.param_type_name == "option"]
        for title, rows in (("Arguments", arguments), ("Options", [row for row in options if row])):
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def _arguments(self, ctx: Any) -> list[Any]:
        return [each for each in self.get_params(ctx) if each.param_type_name == "argument"]


class App(typer.Typer):
    """A Typer application of `Command`s, without rich: formatting the help with it would double the time that --help takes."""

    def __init__(self, **settings: Any) -> None:
        usual = {"no_args_is_help": True, "rich_markup_mode": None, "context_settings": HELP_OPTIONS}
        super().__init__(**(usual | settings))

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Any], Any]:
        """Return a decorator that registers a command."""
        return super().command(name, **({"cls": Command} | settings))

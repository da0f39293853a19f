"""The commands `repro` and `recipe`: list claims about an engine or recipes for it, and write one as a script."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli.common import AsJson
from looping_pendulum.cli.completion import claim_engine_names, recipe_engine_names
from looping_pendulum.cli.terminal import say, show_json

if TYPE_CHECKING:
    from looping_pendulum.repro.claims import Claim

OutFile = Annotated[Path | None, typer.Option(metavar="FILE", help="File to write; default: ENGINE_NAME.py.")]


def repro(
    engine: Annotated[
        str,
        typer.Argument(metavar="ENGINE", help="Engine whose claims are listed (mujoco).", autocompletion=claim_engine_names),
    ],
    variant: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only claims that concern this variant (documented).")
    ] = None,
    claim: Annotated[
        str | None, typer.Option(metavar="NAME", help="Write the script of this claim (tendon_without_friction).")
    ] = None,
    out: OutFile = None,
    as_json: AsJson = False,
) -> None:
    """List the claims about an engine, or write a script that shows one of them to that engine's users.

    The script needs the engine and NumPy only, and not this package. It compares the engine with a closed form; its exit status
    is 1 while the claim holds, and 0 when the engine has mended it. An existing file is left as it is.

    looping-pendulum repro mujoco --claim tendon_without_friction --out tendon.py
    """
    from looping_pendulum.repro.claims import ClaimError, find_claims

    claims = find_claims(engine, variant, claim)
    if claim is None:
        if out is not None:
            raise ClaimError(f"--out: found it without --claim, needed the claim; choose one of `repro {engine}`")
        _list(claims, "claim")
    else:
        _write(claims[0], out, "claim")


def recipe(
    engine: Annotated[
        str,
        typer.Argument(metavar="ENGINE", help="Engine whose recipes are listed (pymunk).", autocompletion=recipe_engine_names),
    ],
    variant: Annotated[str | None, typer.Option(metavar="NAME", help="Write the recipe of this variant (chain).")] = None,
    out: OutFile = None,
    as_json: AsJson = False,
) -> None:
    """List the recipes for a rope over a rod in an engine, or write one as a script for that engine's users.

    The script needs the engine only, and not this package. It prints what it reaches and the exact value; its exit status is 0
    while it reaches it. An existing file is left as it is. The recipes are compared in docs/rope-over-a-cylinder.md.

    looping-pendulum recipe pymunk --variant chain --out rope.py
    """
    from looping_pendulum.repro.claims import RECIPES, ClaimError, find_claims

    recipes = find_claims(engine, variant, folder=RECIPES)
    if variant is None:
        if out is not None:
            raise ClaimError(f"--out: found it without --variant, needed the variant; choose one of `recipe {engine}`")
        _list(recipes, "recipe")
    else:
        _write(recipes[0], out, "recipe")


def _list(claims: list[Claim], kind: str) -> None:
    """Print names and titles."""
    width = max(len(each.name) for each in claims)
    for each in claims:
        say(f"{each.name:{width}}  {each.title}")
    show_json({f"{kind}s": [{kind: each.name, "variant": each.variant, "title": each.title} for each in claims]})


def _write(chosen: Claim, out: Path | None, kind: str) -> None:
    """Write a script where there is no file yet."""
    from looping_pendulum.files import prepare_output_folder, write_atomically
    from looping_pendulum.repro.claims import ClaimError

    path = out or Path(chosen.file_name)
    if path.exists():
        raise ClaimError(f"{path}: found a file, which is left as it is; needed another name: --out OTHER.py")
    prepare_output_folder(path.parent, files=(path.name,))
    write_atomically(path, chosen.source)
    say(f"wrote {path}; it needs {chosen.package} and not this package. Next: python {path}")
    show_json({kind: chosen.name, "file": path})

"""The command `repro`: list what is claimed about an engine, and write a script that shows it without this package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli.common import AsJson
from looping_pendulum.cli.completion import claim_engine_names
from looping_pendulum.cli.terminal import say, show_json


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
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="File to write; default: ENGINE_CLAIM.py.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the claims about an engine, or write a script that shows one of them to that engine's users.

    The script needs the engine and NumPy only, and not this package. It compares the engine with a closed form; its exit status
    is 1 while the claim holds, and 0 when the engine has mended it. An existing file is left as it is.

    looping-pendulum repro mujoco --claim tendon_without_friction --out tendon.py
    """
    from looping_pendulum.files import prepare_output_folder, write_atomically
    from looping_pendulum.repro.claims import ClaimError, find_claims

    claims = find_claims(engine, variant, claim)
    if claim is None:
        if out is not None:
            raise ClaimError(f"--out: found it without --claim, needed the claim; choose one of `repro {engine}`")
        width = max(len(each.name) for each in claims)
        for each in claims:
            say(f"{each.name:{width}}  {each.title}")
        show_json({"claims": [{"claim": each.name, "variant": each.variant, "title": each.title} for each in claims]})
        return
    (chosen,) = claims
    path = out or Path(chosen.file_name)
    if path.exists():
        raise ClaimError(f"{path}: found a file, which is left as it is; needed another name: --out OTHER.py")
    prepare_output_folder(path.parent, files=(path.name,))
    write_atomically(path, chosen.source)
    say(f"wrote {path}; it needs {chosen.package} and not this package. Next: python {path}")
    show_json({"claim": chosen.name, "file": path})

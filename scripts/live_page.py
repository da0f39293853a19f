"""Write the live page that is shipped, in which the package finds the page's script: `python -m scripts.live_page`, with Node.

Whoever writes pages needs no Node, as esbuild runs only here.
"""

import subprocess
from pathlib import Path

from looping_pendulum.live.write import FILE, render

PROJECT = Path(__file__).parents[1]
PAGE = PROJECT / "looping_pendulum" / "live" / FILE
MAIN = 'import "./assets/main.js";'
NODE_MODULES = PROJECT / "node_modules"
ESBUILD = NODE_MODULES / ".bin" / "esbuild"
"""What `npm ci` installs."""


def script() -> str:
    """Return the page's script, after the licence of the library in it."""
    licence = (NODE_MODULES / "lean-qr" / "LICENSE").read_text(encoding="utf-8")
    return f"/* lean-qr, which is a part of this script:\n{licence}*/\n{bundle(MAIN)}"


def bundle(source: str, *options: str) -> str:
    """Return a module in the folder of the live page, and all that it imports, as one minified script."""
    command = [ESBUILD, "--bundle", "--minify", "--charset=utf8", *options]
    return subprocess.run(command, input=source, cwd=PAGE.parent, capture_output=True, encoding="utf-8", check=True).stdout


if __name__ == "__main__":
    PAGE.write_text(render(script=script()), encoding="utf-8")
    print(f"wrote {PAGE}")

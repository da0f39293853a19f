"""Install the project by each way of docs/install.md, literally, and time it: `python -m research.time_installation [WAY ...]`.

Each way is a section of that page. Its first block of shell commands is run line by line in a fresh clone of the last commit.
The home folder is new, so that there is no cache and nobody's settings; the Python that runs this script is first on the path.
A way has succeeded when the demonstration's page, opened in headless Chromium, moves. The times are stored in
research/data/installation.json.
"""

import datetime
import json
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from research import DATA

PROJECT = Path(__file__).parents[1]
PAGE = PROJECT / "docs" / "install.md"
STORED = DATA / "installation.json"
WAYS = {
    "make": "With make",
    "python": "With Python alone",
    "uv": "With uv",
    "pipx": "With pipx",
    "container": "In a container",
}
"""Name of a way -> heading of its section."""
PROGRAMS = {"make": "make", "uv": "uv", "pipx": "pipx", "container": "docker"}
"""Way -> program that it needs."""
DEMO_PAGE = "report/ten_to_one/demo.html"
NETWORK_SETTINGS = ("SSL_CERT_FILE", "SSL_CERT_DIR", "PIP_CERT", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY")
"""Environment variables that the commands inherit, since without them a machine may not reach the package index."""


def commands(way: str) -> list[str]:
    """Return the lines of the first block of shell commands in a way's section."""
    section = PAGE.read_text(encoding="utf-8").split(f"\n## {WAYS[way]}\n")[1].split("\n## ")[0]
    block = re.search(r"^```sh\n(.*?)^```$", section, re.DOTALL | re.MULTILINE)
    if block is None:
        raise SystemExit(f"{PAGE}: {WAYS[way]}: found no block of shell commands")
    return block[1].splitlines()


def time_way(way: str, folder: Path) -> dict[str, Any]:
    """Run a way's commands in a fresh clone in ``folder``, and return the wall and processor times of each line [s]."""
    clone, home = folder / "clone", folder / "home"
    home.mkdir()
    subprocess.run(["git", "clone", "--quiet", PROJECT, clone], check=True)
    tools = [Path(found).parent for tool in PROGRAMS.values() if (found := shutil.which(tool))]
    path = [home / ".local" / "bin", Path(sys.base_prefix) / "bin", *tools, "/usr/local/bin", "/usr/bin", "/bin"]
    environment = {name: os.environ[name] for name in NETWORK_SETTINGS if name in os.environ}
    environment |= {"HOME": str(home), "PATH": ":".join(map(str, path)), "LANG": "C.UTF-8", "PIP_CONFIG_FILE": os.devnull}
    lines = []
    for line in commands(way):
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        subprocess.run(["bash", "-c", line], cwd=clone, env=environment, stdin=subprocess.DEVNULL, check=True)
        wall = time.monotonic() - began
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        lines.append({"command": line, "wall": round(wall, 1), "processor": round(processor, 1)})
    check_that_it_moves(clone / DEMO_PAGE)
    sums = {quantity: round(sum(line[quantity] for line in lines), 1) for quantity in ("wall", "processor")}
    return {**sums, "load": round(os.getloadavg()[1], 1), "lines": lines}


def check_that_it_moves(page_file: Path) -> None:
    """Open the page in headless Chromium, play it, and stop with a message if its picture and its clock stay the same."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
        page.goto(page_file.as_uri())
        seen = [(page.inner_text("#clock"), page.locator("#stage").screenshot())]
        page.click("#play")
        page.wait_for_timeout(1500)
        seen.append((page.inner_text("#clock"), page.locator("#stage").screenshot()))
        browser.close()
    if seen[0][0] == seen[1][0] or seen[0][1] == seen[1][1]:
        raise SystemExit(f"{page_file}: found a page that stands still")


def main(ways: list[str]) -> None:
    """Time ``ways``, and store the results beside those of other ways."""
    unknown = set(ways) - set(WAYS)
    if unknown:
        raise SystemExit(f"found {', '.join(sorted(unknown))}; needed some of {', '.join(WAYS)}")
    missing = [PROGRAMS[way] for way in ways or WAYS if way in PROGRAMS and not shutil.which(PROGRAMS[way])]
    if missing:
        raise SystemExit(f"found no {' and no '.join(missing)} on the path; install it, or name the ways to time")
    stored = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {"ways": {}}
    for way in ways or WAYS:
        with tempfile.TemporaryDirectory() as folder:
            stored["ways"][way] = {
                "measured_on": datetime.date.today().isoformat(),
                "python": platform.python_version(),
                "cores": os.cpu_count(),
                **time_way(way, Path(folder)),
            }
        STORED.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
        print(f"{way}: {stored['ways'][way]['wall']} s")


if __name__ == "__main__":
    main(sys.argv[1:])

"""Code blocks of a page of the documentation, and the package that the page makes of them."""

import importlib.util
import os
import re
import subprocess
import sys
import zipfile

import pytest

from tests.docs_commands import PROJECT

BUILD = "from setuptools.build_meta import build_wheel; build_wheel('dist')"


def blocks(page, language):
    """Return the code blocks of one language, in the order of the page."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def python(site, *arguments, folder=None):
    """Run Python with the packages of the folder ``site``, and with this one."""
    path = os.pathsep.join([str(site), str(PROJECT)])
    environment = os.environ | {"PYTHONPATH": path, "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=600, cwd=folder, env=environment
    )


def install(page, module, tmp_path_factory):
    """Return the page's two files built by pip as a wheel and unpacked, which is how pip installs pure Python."""
    if importlib.util.find_spec("setuptools") is None:  # not imported: it would take the place of distutils in this process
        pytest.skip("setuptools is not installed")
    project, site = tmp_path_factory.mktemp("project"), tmp_path_factory.mktemp("site")
    (project / f"{module}.py").write_text(blocks(page, "python")[0], encoding="utf-8")
    (project / "pyproject.toml").write_text(blocks(page, "toml")[0], encoding="utf-8")
    done = subprocess.run([sys.executable, "-c", BUILD], cwd=project, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = (project / "dist").glob("*.whl")
    zipfile.ZipFile(wheel).extractall(site)
    return site

"""The measurements of films start: one had not since a folder moved."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.long


def printed(*arguments):
    done = subprocess.run([sys.executable, "-m", *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_faults_are_put_into_films(tmp_path):
    asked = ("--count", 2, "--kinds", "turned", "--no-identify", "--failures", tmp_path)
    assert "2 studies; 0 failures" in printed("research.film_faults", *asked)


def test_films_of_strangers_are_rendered(tmp_path):
    printed("research.films_of_strangers", "--only-render", "--seeds", "900", "--folder", tmp_path)
    assert len([*tmp_path.rglob("*.mp4")]) == 3

"""A table in a folder of its own."""

from pathlib import Path

import pytest


@pytest.fixture
def clip(tmp_path, monkeypatch):
    """Return a function that writes a table's text or bytes to a file in the working folder; its result is the file's path."""
    monkeypatch.chdir(tmp_path)

    def write(content):
        path = Path("clip.csv")
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write

"""Texts that are compared whole with what was agreed on."""

import os
from pathlib import Path


def golden(name: str, text: str) -> None:
    """Fail if a text is not the stored one; with ``GOLDEN=write`` store it."""
    path = Path(__file__).with_name(name)
    if os.environ.get("GOLDEN") == "write":
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8"), "meant? GOLDEN=write python -m pytest tests/compare -k golden"

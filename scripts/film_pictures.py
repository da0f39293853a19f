"""Draw the pictures of docs/film.md: python -m scripts.film_pictures"""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from looping_pendulum.film.output import contact_sheet
from looping_pendulum.film.track import TrackSettings, track
from tests.film.renderer import Scene, looping_motion, render

FOLDER = Path(__file__).parents[1] / "docs" / "img"
WIDTH = 900
COLOURS = 160
PAPER = TrackSettings(free_length=0.58, free_length_error=1e-3)


def small(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture as a small PNG: few colours, as wide as the page."""
    image = Image.fromarray(np.ascontiguousarray(picture[..., ::-1]))
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.quantize(COLOURS, Image.Quantize.FASTOCTREE).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def main() -> None:
    """Draw the contact sheet of a good film, and the tiles of one with a long exposure."""
    motion = looping_motion(1.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.mp4"
        render(path, Scene(hand=True, frame_rate=120, exposure=1 / 1000, duration=0.9), motion)
        (FOLDER / "film-sheet.png").write_bytes(small(contact_sheet(track(path, PAPER))))
        render(path, Scene(hand=True, frame_rate=60, exposure=1 / 70, duration=0.9), motion)
        sheet = contact_sheet(track(path, PAPER))
        tiles = slice(58 + 720, 58 + 720 + 640)  # below the head and the scene
        (FOLDER / "film-streak.png").write_bytes(small(sheet[tiles]))


if __name__ == "__main__":
    main()

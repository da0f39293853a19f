"""Draw the pictures of docs/film.md: python -m scripts.film_pictures"""

import io
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from looping_pendulum.measured.film.output import contact_sheet
from looping_pendulum.measured.film.record import FilmTrack, TrackSettings
from looping_pendulum.measured.film.track import track
from tests.measured.film.renderer import Scene, looping_motion, render, seen_by_a_camera

FOLDER = Path(__file__).parents[1] / "docs" / "img"
WIDTH = 900
COLOURS = 160
PAPER = TrackSettings(free_length=0.58, free_length_error=1e-3)
HEAD, SCENE, TILES = 58, 720, 640
"""Heights of the parts of a contact sheet of a picture of 1280x720 [pixels]."""


def small(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture as a small PNG: few colours, as wide as the page."""
    image = Image.fromarray(np.ascontiguousarray(picture[..., ::-1]))
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.quantize(COLOURS, Image.Quantize.FASTOCTREE).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def main() -> None:
    """Draw the contact sheet of a good film, and what five bad ones look like on theirs."""
    motion = looping_motion(1.0)
    usual = Scene(frame_rate=120, exposure=1 / 1000, duration=0.9)
    tiles, plot = slice(HEAD + SCENE, HEAD + SCENE + TILES), slice(-170, None)

    with tempfile.TemporaryDirectory() as folder:

        def tracked(**changes: object) -> FilmTrack:
            path = Path(folder) / "trial.mp4"
            render(path, Scene(**{**vars(usual), **changes}), motion)
            return track(path, PAPER)

        def draw(name: str, found: FilmTrack, part: slice) -> None:
            (FOLDER / f"film-{name}.png").write_bytes(small(contact_sheet(found)[part]))

        draw("sheet", tracked(hand=True), slice(None))
        draw("streak", tracked(hand=True, frame_rate=60, exposure=1 / 70), tiles)
        draw("aside", tracked(project=seen_by_a_camera(usual, aside=5)), plot)
        draw("shutter", tracked(readout=0.015), plot)


if __name__ == "__main__":
    main()

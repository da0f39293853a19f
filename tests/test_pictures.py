"""What draws a picture of the documentation by parts of the program still can; its commands have their own tests."""

import matplotlib.image
import pytest

from looping_pendulum.teaching.example_folder import write_example
from scripts.pictures import draw_evidence

pytestmark = pytest.mark.long


def test_the_picture_of_the_evidence_is_drawn(tmp_path):
    write_example(tmp_path / "study")
    draw_evidence(tmp_path / "study" / "study.yaml", tmp_path / "evidence.png")
    height, width, _ = matplotlib.image.imread(tmp_path / "evidence.png").shape
    assert 2 < width / height < 4

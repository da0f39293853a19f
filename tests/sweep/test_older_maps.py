"""Maps written before a field had its present name are read and gone on with."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from looping_pendulum.sweep import map_file, open_map, run_map
from looping_pendulum.sweep.plan import MapError
from tests.sweep import fake
from tests.sweep.maps import GRID, SAMPLE


def make(plan, folder):
    return run_map(plan, folder, jobs=1, figures=False, solve=fake.solve)


def rename_to_reslips(folder):
    """Give the array `slip_count` of a map the name and the explanation that it had before."""
    store = folder / "map.zarr"
    (store / "slip_count").rename(store / "reslips")
    for file in (store / "zarr.json", store / "reslips" / "zarr.json"):
        text = file.read_text().replace("slip_count", "reslips")
        file.write_text(text.replace("how often a string at rest on the rod began to slide again", "how often it broke away"))


@pytest.mark.parametrize("text", [GRID, SAMPLE])
def test_a_map_that_says_reslips_is_read_and_gone_on_with(tmp_path, text):
    """Oracle: the same map under today's name; the older one is made from it, and lacks two chunks."""
    plan = map_file.load_text(text)
    make(plan, tmp_path / "now")
    shutil.copytree(tmp_path / "now", tmp_path / "before")
    rename_to_reslips(tmp_path / "before")
    now, before = open_map(tmp_path / "now"), open_map(tmp_path / "before")
    assert before["slip_count"].dims == now["slip_count"].dims
    assert np.array_equal(before["slip_count"], now["slip_count"])
    assert "reslips" not in before
    chunks = [path for path in (tmp_path / "before" / "map.zarr" / "reslips" / "c").rglob("*") if path.is_file()]
    for chunk in sorted(chunks)[-2:]:
        chunk.unlink()
    assert make(plan, tmp_path / "before").runs_before < plan.runs
    assert make(plan, tmp_path / "before").runs_before == plan.runs
    assert not (tmp_path / "before" / "map.zarr" / "slip_count").exists()
    assert np.array_equal(open_map(tmp_path / "before")["slip_count"], now["slip_count"])
    assert (tmp_path / "before" / "map.md").read_bytes() == (tmp_path / "now" / "map.md").read_bytes()


def test_a_damaged_description_of_an_older_map_is_named_too(tmp_path):
    plan = map_file.load_text(GRID)
    make(plan, tmp_path)
    rename_to_reslips(tmp_path)
    path = tmp_path / "map.zarr" / "reslips" / "zarr.json"
    path.write_text(path.read_text().replace("int32", "int16"))
    with pytest.raises(MapError, match=r"reslips/zarr.json: found it damaged \(data_type"):
        make(plan, tmp_path)

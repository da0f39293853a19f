"""Which files a study may have read: those below its own folder, the current one or a data folder, wherever its text points."""

import os

import pytest

from looping_pendulum.measured import study_io
from looping_pendulum.measured.study_io import StudyError

STUDY = """
title: t
apparatus: {light: {mass: 10 g}, heavy: {mass: 100 g}, rod: {radius: 6 mm}}
trials:
  - {name: one, file: %s, release: {angle: 112 deg, free_length: 58 cm}}
"""


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A study's folder, the current folder, a data folder, and one that is none of them."""
    for name in ("study/trials", "here/data", "data", "secret"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "secret" / "passwd").write_text("root:x:0:0\nsecret:hash\n")
    (tmp_path / "study" / "link.csv").symlink_to(tmp_path / "secret" / "passwd")
    (tmp_path / "study" / "folder").symlink_to(tmp_path / "secret")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("LOOPING_PENDULUM_DATA", str(tmp_path / "data"))
    return tmp_path


def written(folders, file):
    path = folders / "study" / "study.yaml"
    path.write_text(STUDY % file)
    return path


@pytest.mark.parametrize(
    "file",
    ["../secret/passwd", "../../../../../../../../etc/passwd", "/etc/passwd", "link.csv", "folder/passwd",
     "trials/../../secret/passwd", "'~/.ssh/../../etc/passwd/../../../../../etc/passwd'", "../study2/a.csv"],
)  # fmt: skip
def test_a_file_elsewhere_is_not_read_and_nothing_of_it_is_shown(folders, file, monkeypatch):
    """`file: ../../../../etc/passwd` was opened, and its last line stood in the error."""
    path = written(folders, file)
    opened = []
    monkeypatch.setattr("looping_pendulum.measured.readers.read_bytes", lambda *a: opened.append(a) or b"")
    with pytest.raises(StudyError, match=r"^[^\n]*study.yaml:5: trials\[0\].file: found '[^\n]*needed a file below") as caught:
        study_io.load(path)
    assert opened == []
    assert "hash" not in str(caught.value)


def test_each_kind_of_file_of_a_trial_is_looked_at(folders):
    path = folders / "study" / "study.yaml"
    for more, key in (
        ("files: {light: a.csv, heavy: /etc/passwd}", "files.heavy"),
        ("file: a.csv, events: /etc/passwd", "events"),
    ):
        path.write_text((STUDY % "x").replace("file: x", more))
        with pytest.raises(StudyError, match=key):
            study_io.load(path)


def test_files_below_the_study_the_current_folder_and_the_data_folder_are_taken(folders):
    for place in ("study/a.csv", "study/trials/a.csv", "here/a.csv", "data/a.csv", "here/data/a.csv"):
        relative = os.path.relpath(folders / place, folders / "study")
        for file in (relative, str(folders / place)):
            assert study_io.load(written(folders, file)).trials[0].files[0][0] == file

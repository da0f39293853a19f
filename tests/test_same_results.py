"""The script by which a change of structure shows that it moved no result."""

import dataclasses

import numpy as np
from typer.testing import CliRunner

from scripts import same_results
from scripts.same_results import _said


@dataclasses.dataclass
class Result:
    t: np.ndarray
    count: int = 1


def test_a_difference_of_the_last_bit_is_seen():
    one, other = Result(np.array([0.1, 0.2])), Result(np.array([0.1, np.nextafter(0.2, 1)]))
    assert _said(one) == _said(Result(np.array([0.1, 0.2])))
    assert _said(one) != _said(other)
    assert _said(one).startswith("3 numbers")


def test_what_differs_is_shown_and_counts(tmp_path, capsys):
    for action in ("record", "compare"):
        assert main_exits(action, tmp_path) == 0
    file = tmp_path / "imports" / "modules.txt"
    file.write_text(file.read_text().replace("looping_pendulum.cli.main", "looping_pendulum.cli.other"))
    capsys.readouterr()
    assert main_exits("compare", tmp_path) == 1
    shown = capsys.readouterr().out
    assert "1 of 1 files differ" in shown
    assert "-looping_pendulum.cli.other" in shown
    assert "+looping_pendulum.cli.main" in shown


def main_exits(action, folder):
    import typer

    app = typer.Typer()
    app.command()(same_results.main)
    result = CliRunner().invoke(app, [action, str(folder), "--only", "imports"])
    print(result.output)
    return result.exit_code

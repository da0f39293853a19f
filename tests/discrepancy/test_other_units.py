"""Data in another unit than the study says are refused within seconds; those that a camera may give are not.

With lengths or times wrong by a factor `identify` searched for more than five minutes, and then called it an unlisted force.
"""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest

from looping_pendulum.discrepancy.data import study_io
from looping_pendulum.discrepancy.data.observations import DataError
from looping_pendulum.discrepancy.data.study import Estimate, read_trial
from looping_pendulum.discrepancy.fit.other_units import refuse_wrong_units
from looping_pendulum.discrepancy.fit.problem import Problem, free_parameters_of
from looping_pendulum.discrepancy.fit.residual import trial_data
from looping_pendulum.discrepancy.identify import OutOfTimeError, identify
from looping_pendulum.teaching.example_folder import write_example


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The example's two trials, whose tracked points a separate simulator and camera made."""
    folder = tmp_path_factory.mktemp("example") / "new"
    write_example(folder)
    return study_io.load(folder / "study.yaml")


@pytest.fixture(scope="module")
def observed(study):
    return [read_trial(study, trial) for trial in study.trials]


def problem(study, observed, which, lengths=1.0, times=1.0, shift=0.0, tilt=0.0, camera=None):
    trial, observations = study.trials[which], observed[which]
    channels = []
    for c in observations.channels:
        other = next(o for o in observations.channels if o.name == c.name[:-1] + ("y" if c.name.endswith("x") else "x"))
        across = np.interp(c.t, other.t, other.value) * (1 if c.name.endswith("y") else -1)
        turned = c.value * np.cos(tilt) + across * np.sin(tilt)
        channels.append(dataclasses.replace(c, t=c.t * times, value=lengths * turned + shift))
    trial = dataclasses.replace(trial, camera=camera or {})
    observations = dataclasses.replace(observations, channels=tuple(channels))
    return Problem(study, [trial_data(trial, observations)], free_parameters_of(study, [(trial, observations)]))


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("factor", [1 / 100, 1 / 39.37, 1 / 8, 1 / 2, 2, 2.54, 8, 10, 100])
def test_lengths_and_times_in_another_unit_are_refused_with_the_factor(study, observed, which, factor):
    for what in ("lengths", "times"):
        with pytest.raises(DataError, match=rf"^trial '(first|second)': found {what} that are [^\n]+$") as caught:
            refuse_wrong_units(problem(study, observed, which, **{what: factor}))
        factor_in_message = float(str(caught.value).partition("(times ")[2].partition(",")[0])
        # tried factors on times are a fourth of an octave apart; those on lengths follow from the points, to 3 % here
        assert abs(np.log2(factor_in_message * factor)) <= (1 / 4 if what == "times" else 0.05) + 0.005


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize(
    "camera",
    [{}, {"lengths": 1.05}, {"lengths": 0.9}, {"times": 1.03}, {"times": 0.95}, {"shift": 5.0}, {"tilt": 0.1}, {"tilt": -0.1}],
)
def test_what_a_camera_may_get_wrong_is_no_other_unit(study, observed, which, camera):
    refuse_wrong_units(problem(study, observed, which, **camera))


def test_a_factor_that_the_study_leaves_open_is_left_to_the_fit(study, observed):
    free = Estimate(value=1.0, free=True)
    refuse_wrong_units(problem(study, observed, 0, lengths=3.0, camera={"scale": free, "clock_ratio": free}))
    refuse_wrong_units(problem(study, observed, 0, times=8.0, camera={"scale": free, "clock_ratio": free}))


def test_a_wrong_apparatus_is_no_other_unit(study, observed):
    """What the declared model lacks is for the fit to find: twice the mass, half the friction, ten times the drag."""
    for changes in ({"heavy_mass": 0.2}, {"heavy_mass": 0.06}, {"light_mass": 0.015}):
        trial = study.trials[0]
        own = trial.estimates | {name: Estimate(value=value) for name, value in changes.items()}
        other = dataclasses.replace(trial, estimates=own)
        changed = dataclasses.replace(study, trials=(other, *study.trials[1:]))
        refuse_wrong_units(problem(changed, observed, 0))


def test_identify_says_so_at_once(study, tmp_path):
    write_example(tmp_path / "new")
    for name in ("first", "second"):
        path = Path(tmp_path / "new" / "trials" / f"{name}.csv")
        rows = [line.split(",") for line in path.read_text().splitlines()]
        scaled = [[str(8 * float(row[0])), *row[1:]] if is_number(row[0]) else row for row in rows]
        path.write_text("\n".join(",".join(row) for row in scaled) + "\n")
    started = time.process_time()
    with pytest.raises(DataError, match="found times that are 8 times what the declared apparatus allows"):
        identify(study_io.load(tmp_path / "new" / "study.yaml"), workers=1)
    assert time.process_time() - started < 60


def test_a_search_ends_with_its_time_limit(study):
    """Before anything is fitted there is nothing to report; later, the search reports as after Ctrl-C (test_identify)."""
    with pytest.raises(OutOfTimeError, match=r"^--time-limit: found no fit of the declared model within 1e-09 s; check"):
        identify(study, workers=1, time_limit=1e-9)


def is_number(text):
    try:
        return bool(text) and np.isfinite(float(text))
    except ValueError:
        return False

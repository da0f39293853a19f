"""The next trial is the one that separates most pairs of explanations; how well, decides between equals."""

from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.discrepancy import next_experiment
from looping_pendulum.discrepancy.next_experiment import MIN_SEPARATION
from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.parameters import Release

NAMES = (("clock_ratio",), ("wrong_gravity",), ("scale",))


def best(monkeypatch, predictions):
    """Return the trials that are proposed; ``predictions``: name -> one value of each explanation [units of noise], or None."""
    trials = [SimpleNamespace(name=name, release=Release.LOOPING) for name in predictions]
    angles = {name: float(i) for i, name in enumerate(predictions)}

    def parameters(_, trial):
        return SimpleNamespace(release_angle=angles[trial.name], heavy_mass=0.1, light_mass=0.02, free_length=0.5)

    def predict(study, trial, number):
        if predictions[trial.name] is None:
            raise HarnessError("the run does not end")
        value = np.array([predictions[trial.name][number]])
        return SimpleNamespace(values=value, jacobian=np.array([[0.0], [1.0]]))

    monkeypatch.setattr(next_experiment, "_trials", lambda study: trials)
    monkeypatch.setattr(next_experiment, "_predict", predict)
    experiments = next_experiment.best_experiments(SimpleNamespace(parameters=parameters), (0, 1, 2), NAMES)
    return [(list(predictions)[int(e.release_angle)], e) for e in experiments]


def test_a_pair_that_no_trial_separates_does_not_make_all_trials_equally_bad(monkeypatch):
    near, far = 2 * MIN_SEPARATION, 9 * MIN_SEPARATION
    found = best(
        monkeypatch,
        {
            "one": (0.0, 0.6 * MIN_SEPARATION, 1.2 * MIN_SEPARATION),
            "both": (0.0, 0.1, near),
            "better": (0.0, 0.1, far),
            "none": (0.0, 0.1, 0.3),
            "fails": None,
        },
    )
    assert [name for name, _ in found] == ["better", "both", "one"]
    first = found[0][1]
    assert (first.separated_pairs, first.pairs, first.tells_apart) == (2, 3, ("wrong_gravity", "scale"))
    assert first.distance == pytest.approx(far - 0.1)
    assert first.mass_ratio == pytest.approx(5.0)


def test_where_none_separates_anything_the_nearest_to_it_comes_first(monkeypatch):
    found = best(monkeypatch, {"less": (0.0, 0.1, 0.2), "more": (0.0, 0.4, 0.8)})
    assert [name for name, _ in found] == ["more", "less"]
    assert (found[0][1].separated_pairs, found[0][1].distance) == (0, pytest.approx(0.4))

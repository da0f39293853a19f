"""Engines by name and as objects, in one comparison."""

import pytest

from looping_pendulum.compare.harness import chosen_engines, compare_engines
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import engine, label
from looping_pendulum.errors import EngineError
from looping_pendulum.scenarios import loader


def test_names_and_objects_are_chosen():
    own = engine("mujoco:capstan", time_step=5e-4)
    chosen = chosen_engines([own, "mujoco:documented"], Profile.QUICK)
    assert [label(each) for each in chosen] == ["mujoco:capstan", "mujoco:documented"]
    assert chosen[0] is own
    assert [label(each) for each in chosen_engines("mujoco:capstan", Profile.QUICK)] == ["mujoco:capstan"]
    assert len(chosen_engines((), Profile.QUICK)) > 2


@pytest.mark.parametrize("wrong", [3, None, loader])
def test_what_is_neither_is_one_line(wrong):
    with pytest.raises(EngineError, match="engines: found .*, needed a name such as 'pymunk', or an engine"):
        chosen_engines([wrong], Profile.QUICK)


@pytest.mark.long
def test_an_object_runs_with_its_own_settings():
    own = engine("mujoco:capstan", time_step=5e-4)
    result = compare_engines(loader.load("atwood"), engines=[own])
    assert result.engines[0].provenance.settings["time_step"] == 5e-4
    assert result.rows()[0]["engine"] == "mujoco:capstan"

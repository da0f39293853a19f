"""The shipped data files are read whole: counts and first values as the files have them."""

import pytest

from looping_pendulum.measured.observations import Observations, with_event_errors
from looping_pendulum.measured.readers import read
from tests.discrepancy.real_data import real


@pytest.mark.parametrize(
    ("file", "drops"),
    [("baseball", (44, 44)), ("bowling_ball", (43, 42)), ("green_basketball", (45, 44)), ("tennis_ball", (46, 47)),
     ("wiffle_ball_1", (54, 53))],
)  # fmt: skip
def test_the_falling_balls(file, drops):
    path = real(f"falling_balls/{file}.csv")
    for drop, count in enumerate(drops, start=1):
        observations = read(path, run=str(drop))
        height = observations.channel("height")
        assert len(height) == count
        assert 45 < height.value[0] < 49
        assert height.value[-1] < 20
        assert [(d.count, d.reason) for d in observations.unused] == [
            (count, "column 'velocity_m_per_s': not a time or a position")
        ]


def test_the_pendulum():
    observations = read(real("pendulum/free_decay_65cm.txt"))
    assert [c.name for c in observations.channels] == ["angle"]
    assert len(observations.channel("angle")) == 2330
    assert observations.channel("angle").value[0] == 0.7020338666008175
    # Its third column follows neither the angle nor its slope.
    assert observations.unused[0].count == 2330
    assert "not the rate of the angle" in observations.unused[0].reason


def test_the_papers_tables():
    ten = read(real("paper/trial_10to1.csv"))
    assert len(ten.events) == 16
    assert ten.events[0].value == 0.38
    assert {e.sigma for e in ten.events} == {0.01}
    assert ten.unused[0].count == 3
    two = read(real("paper/trial_2to1.csv"))
    assert {e.quantity: (e.value, e.sigma) for e in two.events}["halting_time"] == (1.0, 0.1)  # printed as 1.0
    better = with_event_errors(two, {"s": 0.008})
    assert {e.sigma for e in better.events if e.unit == "s"} == {0.008}
    assert {e.sigma for e in better.events if e.unit == "m"} == {0.01}
    assert isinstance(better, Observations)

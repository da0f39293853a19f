"""The sentences of a story, each from numbers that were chosen: what a reader must see, and what must not be said."""

from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.compare.align import why_not_comparable
from looping_pendulum.compare.deviation import EVENT_DESCRIPTIONS, Departure, events_to_show, mode_description
from looping_pendulum.compare.stories import missing_physics, story
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.events import MIN_REST, Landmarks, Rebound, Stop
from looping_pendulum.runs.trajectory import SAME_TIME, UNKNOWN_MODE, RunStatus, Supplier, Supplies, Supply


def supplied(winding="engine", friction="engine", stick="engine", drag="engine"):
    makers = {"winding": winding, "friction_law": friction, "stick_slip": stick, "drag": drag}
    return Supplies(**{what: Supply(by=Supplier(by), how="somehow") for what, by in makers.items()})


def departure(threshold=1e-3, time=0.2, **other):
    fields = {"mode": "the string slides", "after": "release", "after_time": 0.0, "along": 2e-3, "across": 3e-3, "heavy": 4e-3}
    return Departure(threshold=threshold, time=time, **(fields | other))


def story_of(
    parameters,
    departures=(),
    own=None,
    true=None,
    supplies=None,
    end=1.05,
    status=RunStatus.FINISHED,
    lacks=(),
    not_comparable="",
):
    run = SimpleNamespace(t=np.array([0.0, end]), status=status, lacks=lacks)
    own, true = own or Landmarks(), true or Landmarks()
    return story(run, parameters, supplies or supplied(), departures, own, true, not_comparable)


@pytest.fixture
def parameters(closed_form):
    """Friction that holds and slides alike, no drag."""
    return closed_form.parameters.replace(kinetic_friction=0.34, static_friction=0.34)


HALTS = Landmarks(halting_time=0.9)


def test_a_run_without_samples_has_no_motion(parameters):
    run = SimpleNamespace(t=np.zeros(0), status=RunStatus.MISSING, lacks=())
    said = story(run, parameters, supplied(), (), Landmarks(), Landmarks())
    assert said == f"No motion to compare: {RunStatus.MISSING.value}."


def test_a_run_within_a_millimetre_stays_there_to_its_end(parameters):
    assert story_of(parameters) == "Stays within 1 mm of the reference up to 1.050 s, where the comparison ends."


@pytest.mark.parametrize(
    ("after", "when", "words"),
    [
        ("halt", 0.14, ", 60 ms after the halt"),
        ("slip_onset", 0.188, ", 12 ms after the string began to slide again"),
        ("some_thing", 0.14, ", 60 ms after some thing"),
        ("release", 0.0, ""),
    ],
)
def test_it_leaves_a_band_so_long_after_an_event(parameters, after, when, words):
    departures = (departure(after=after, after_time=when), departure(0.01, 0.7))
    said = story_of(parameters, departures)
    assert said.startswith(
        f"First deviates by more than 1 mm at 0.200 s, while the string slides{words}; by more than 10 mm at 0.700 s. "
    )
    assert story_of(parameters, departures[:1]).startswith(
        f"First deviates by more than 1 mm at 0.200 s, while the string slides{words}. At "
    )


def test_times_and_bands_are_in_thousandths(parameters):
    departures = (departure(0.6, 0.9, after="halt", after_time=0.3), departure(0.7, 1.0))
    said = story_of(parameters, departures)
    assert said.startswith(
        "First deviates by more than 600 mm at 0.900 s, while the string slides, 600 ms after the halt; by more than 700 mm at"
    )


@pytest.mark.parametrize(("sign", "words"), [(1, ("out", "ahead", "higher")), (-1, ("in", "behind", "lower"))])
def test_to_which_side_it_departs(parameters, sign, words):
    out, ahead, up = words
    said = story_of(parameters, (departure(along=sign * 2e-3, across=sign * 3e-3, heavy=sign * 4e-3),))
    where = f"its light mass is 2 mm further {out} along the string and 3 mm {ahead} across it, and its heavy mass is 4 mm {up}"
    assert f"At that time {where} than the reference's." in said
    dropped = story_of(parameters.replace(release=Release.DROP), (departure(heavy=sign * 4e-3),))
    assert f"At that time its heavy mass is 4 mm {up} than the reference's." in dropped
    assert "light mass" not in dropped


def test_what_does_not_move_is_not_ahead(parameters):
    said = story_of(parameters, (departure(along=0.0, across=0.0, heavy=0.0),))
    assert "further in along the string" in said
    assert "behind across it" in said
    assert "lower than" in said


@pytest.mark.parametrize(
    ("stretch", "said"),
    [
        (None, "All the physics of the scenario is modelled (by the engine: the winding, the"),
        (0.0, "sticking and slipping), and its string did not stretch. Suspect"),
        (4e-4, "sticking and slipping), and its string had stretched by no more than 0.4 mm. Suspect"),
        (5e-4, "Likely cause: its string had stretched by up to 0.5 mm by then."),
        (6e-4, "Likely cause: its string had stretched by up to 0.6 mm by then."),
    ],
)
def test_a_string_stretched_by_half_of_the_deviation_is_a_cause(parameters, stretch, said):
    assert said in story_of(parameters, (departure(stretch=stretch),))


def test_who_supplies_the_physics_that_is_there(parameters):
    departures = (departure(),)
    own = "by the engine: the winding, the string's friction on the rod and sticking and slipping"
    end = ". Suspect its time step, its solver or a coefficient."
    assert f"({own}){end}" in story_of(parameters, departures), "the drag is supplied, but this scenario has none"
    fed = story_of(parameters, departures, supplies=supplied(friction="adapter", stick="adapter"))
    friction = "by the adapter: the string's friction on the rod and sticking and slipping"
    assert f"(by the engine: the winding; {friction}){end}" in fed
    all_fed = story_of(parameters, departures, supplies=supplied(*["adapter"] * 4))
    assert "by the engine" not in all_fed
    nothing = story_of(parameters.replace(release=Release.DROP), departures)
    assert "All the physics of the scenario is modelled." in nothing


def test_physics_that_has_not_acted_yet_is_no_cause(parameters):
    # Sticking matters only once the string has come to rest.
    lacking = supplied(stick="nobody")
    before = story_of(parameters, (departure(),), supplies=lacking)
    assert "All the physics that had acted by then is modelled" in before
    assert "Likely cause" not in before
    after = story_of(parameters, (departure(after="stop", after_time=0.1),), supplies=lacking)
    assert "Likely cause: neither the engine nor the adapter models sticking and slipping, which this scenario has." in after
    both = story_of(parameters, (departure(stretch=1e-3),), supplies=supplied(friction="nobody", stick="nobody"))
    assert "the adapter models the string's friction on the rod, which this scenario has; its string had" in both


def test_a_static_friction_that_a_run_lacks_is_reported_with_both_coefficients(parameters):
    two = parameters.replace(static_friction=0.4)
    said = story_of(two, lacks=("static_friction",))
    assert said.endswith(
        "It has one friction coefficient where this scenario has two (0.4 before it slides, 0.34 while it does): "
        "its run lacks the static one."
    )
    assert "one friction coefficient" not in story_of(two)
    without = story_of(two, supplies=supplied(friction="nobody"), lacks=("static_friction",))
    assert "one friction coefficient" not in without, "it has none at all"


def test_missing_is_what_nobody_supplies_and_the_scenario_has(parameters):
    nobody = supplied(*["nobody"] * 4)
    assert missing_physics(nobody, parameters) == ("winding", "friction_law", "stick_slip")
    assert missing_physics(nobody, parameters.replace(heavy_drag=1e-3), ("drag", "static_friction")) == (
        "winding", "friction_law", "stick_slip", "drag", "static_friction",
    )  # fmt: skip
    assert missing_physics(supplied("adapter", drag="nobody"), parameters) == ()


@pytest.mark.parametrize(
    ("late", "said"),
    [
        (0.002, "Halts 2 ms late."),
        (-0.002, "Halts 2 ms early."),
        (1.2e-5, "Halts 0.012 ms late."),
        (8e-6, "Halts on time."),
        (-8e-6, "Halts on time."),
        (0.0, "Halts on time."),
    ],
)
def test_how_late_it_halts(parameters, late, said):
    own = Landmarks(halting_time=0.9 + late, halting_confirmed=True)
    assert story_of(parameters, own=own, true=HALTS).endswith(said)


@pytest.mark.parametrize(
    ("confirmed", "status", "seen"),
    [
        (False, RunStatus.FINISHED, True),
        (True, RunStatus.FINISHED, False),
        (False, RunStatus.LIGHT_REACHED_ROD, False),
        (True, RunStatus.LIGHT_REACHED_ROD, False),
    ],
)
def test_only_a_halt_that_was_cut_is_reported_as_seen_until_the_end(parameters, confirmed, status, seen):
    own = Landmarks(halting_time=0.9, halting_confirmed=confirmed)
    said = story_of(parameters, own=own, true=HALTS, status=status)
    assert said.endswith("Halts on time (at rest until the run ends at 1.050 s)." if seen else "Halts on time.")


def stops(*times):
    return tuple(Stop(time=time, height_change=-0.2) for time in times)


@pytest.mark.parametrize(
    ("own", "supplies", "said"),
    [
        (Landmarks(), {}, "does not halt to within 0.1 mm (the reference's halts at 0.900 s)."),
        (Landmarks(stops=stops(0.4)), {}, "halts at 0.900 s); it stops at 0.400 s and moves on."),
        (
            Landmarks(stops=stops(0.4, 0.5, 0.6, 0.7)),
            {"friction": "nobody", "stick": "nobody"},
            "does not halt (the reference's halts at 0.900 s); it stops at 0.400 s, 0.500 s and 0.600 s and moves on: "
            "neither the engine nor the adapter models the string's friction on the rod or sticking and slipping.",
        ),
        (
            Landmarks(),
            {"stick": "nobody"},
            "halts at 0.900 s): neither the engine nor the adapter models sticking and slipping.",
        ),
        (Landmarks(), {"winding": "nobody"}, "does not halt to within 0.1 mm (the reference's halts at 0.900 s)."),
    ],
)
def test_a_heavy_mass_that_does_not_halt(parameters, own, supplies, said):
    assert story_of(parameters, own=own, true=HALTS, supplies=supplied(**supplies)).endswith(said)


def test_a_run_that_ends_before_the_reference_halts(parameters):
    reached = story_of(parameters, own=Landmarks(light_reaches_rod=0.8), true=HALTS, end=0.8)
    assert reached.endswith("Its light mass reaches the rod at 0.800 s, before the reference's heavy mass halts (0.900 s).")
    assert story_of(parameters, own=Landmarks(), true=HALTS, end=0.8).endswith("where the comparison ends.")
    assert "does not halt" in story_of(parameters, own=Landmarks(), true=HALTS, end=0.9)


def test_a_halt_that_the_reference_lacks(parameters):
    assert story_of(parameters, own=HALTS).endswith("Its heavy mass comes to rest at 0.900 s; the reference's never does.")


def test_a_halt_that_is_not_comparable_is_not_reported_as_late(parameters):
    own = Landmarks(halting_time=0.5)
    said = story_of(parameters, own=own, true=HALTS, not_comparable="the run ends at 0.600 s")
    assert said.endswith("Its halt is not comparable: the run ends at 0.600 s.")
    assert "early" not in said


@pytest.mark.parametrize(("travel", "seen"), [(0.9e-4, False), (1e-4, False), (2e-4, True)])
def test_a_rebound_counts_above_the_resolution(parameters, travel, seen):
    own = Landmarks(rebound=Rebound(travel=travel, speed=0.03))
    said = story_of(parameters, own=own)
    assert ("After its first rest it still moves by 0.2 mm, at up to 30 mm/s." in said) is seen
    assert ("first rest" in said) is seen


def test_a_run_that_broke_off_says_when_and_why(parameters):
    said = story_of(parameters, status=RunStatus.CRASHED)
    assert said.endswith(f"The run broke off at 1.050 s: {RunStatus.CRASHED.value}.")
    assert "broke off" not in story_of(parameters, status=RunStatus.LIGHT_REACHED_ROD)


def test_a_halt_is_reported_once_and_other_events_each():
    """The reference names a halt thrice: it is a stop and a stick too. What comes between the two is reported as well."""
    at = [("release", 0.0), ("slack", 0.1), ("stop", 0.3), ("stick", 0.3), ("halt", 0.3), ("stop", 0.4), ("unheard", 0.5)]
    assert events_to_show(at) == [("slack", 0.1), ("halt", 0.3), ("stop", 0.4)]
    assert events_to_show(reversed(at)) == events_to_show(at)
    assert events_to_show([("stop", 0.3), ("stick", 0.3 + 0.1 * SAME_TIME)]) == [("stop", 0.3)]
    assert events_to_show([("stop", 0.3), ("stick", 0.3 + 10 * SAME_TIME)])[1:] == [("stick", 0.3 + 10 * SAME_TIME)]
    assert events_to_show([("stick", 0.3), ("stop", 0.3)]) == [("stick", 0.3)]


def test_events_of_one_moment_that_are_not_one_are_both_reported():
    assert events_to_show([("taut", 0.3), ("slip_onset", 0.3)]) == [("taut", 0.3), ("slip_onset", 0.3)]
    assert events_to_show([("slip_onset", 0.3), ("stop", 0.3)]) == [("slip_onset", 0.3)], "one that turns at once"
    assert events_to_show([(name, 0.1 * k) for k, name in enumerate(EVENT_DESCRIPTIONS)])[0] == ("stop", 0.1)


def test_every_mode_of_the_reference_has_words_of_its_own():
    words = {mode_description(int(mode)) for mode in Mode}
    assert len(words) == len(Mode)
    assert mode_description(int(Mode.STICKING)) == "the string sticks to the rod"
    assert mode_description(UNKNOWN_MODE) == "the mode of the reference is unknown"


class Reference:
    """A reference that halts at ``halt`` [s], and rests from ``rests`` [s] on if it is cut."""

    def __init__(self, halt=None, rests=None):
        self.halt, self.rests, self.asked = halt, rests, []

    def landmarks_beside(self):
        return Landmarks(halting_time=self.halt)

    def landmarks_until(self, end):
        self.asked.append(end)
        return Landmarks(halting_time=self.rests)


def watched(end, own=None, reference=None, status=RunStatus.FINISHED):
    run = SimpleNamespace(t=np.array([0.0, end]), status=status)
    return why_not_comparable(run, Landmarks(halting_time=own), reference or Reference(0.9))


RESTS = "its string rests from 0.700 s to the end of the run"


@pytest.mark.parametrize(
    ("end", "own", "said"),
    [
        (0.8, None, "the run ends at 0.800 s, before the reference halts at 0.900 s"),
        (0.8, 0.7, f"the run ends at 0.800 s, before the reference halts at 0.900 s; {RESTS}"),
        (0.9, None, "the run ends at 0.900 s, less than 50 ms after the reference halts at 0.900 s"),
        (0.94, 0.7, f"the run ends at 0.940 s, less than 50 ms after the reference halts at 0.900 s; {RESTS}"),
        (0.9 + MIN_REST, None, ""),
        (0.96, 0.7, ""),
    ],
)
def test_a_run_is_watched_until_50_ms_after_the_references_halt(end, own, said):
    assert watched(end, own) == said


def test_a_run_that_came_to_its_end_was_watched():
    assert watched(0.8, status=RunStatus.LIGHT_REACHED_ROD) == ""
    assert why_not_comparable(SimpleNamespace(t=np.zeros(0), status=RunStatus.MISSING), Landmarks(), Reference(0.9)) == ""


def test_beside_a_reference_that_slides_again_a_cut_rest_says_nothing():
    resting = Reference(None, rests=0.6)
    assert watched(0.8, 0.6, resting) == (
        "the run ends at 0.800 s, when its string rests; the reference's rests then too, but slides again later"
    )
    assert resting.asked == [0.8], "cut where the run was"
    assert watched(0.8, None, Reference(None, rests=0.6)) == ""
    assert watched(0.8, 0.6, Reference(None)) == "", "a rest that the reference does not have at that time, either"

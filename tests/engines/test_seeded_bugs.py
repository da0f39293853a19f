"""Plant bugs in the adapter of docs/write-an-engine.md, one at a time, and test which conformance checks catch each.

Each bug is a change of the page's own code, as a typing error would make it, or of the samples that the adapter returns.
Unless a bug concerns another release, the engine declares only the looping release, so that no other release reveals it.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from looping_pendulum.engines.conformance import CHECKS, CachedEngine, skip_reason
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Profile
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import Supplier, Supply, Trajectory
from tests.engines.page_example import PAGE, blocks, module

SOURCE = blocks("python")[0]
BY_NAME = {check.__name__: check for check in CHECKS}


@dataclass(frozen=True, kw_only=True)
class Bug:
    """One bug and the checks that must catch it, each by itself."""

    name: str
    caught_by: tuple[str, ...]
    code: tuple[tuple[str, str], ...] = ()
    """Replacements (old, new) in the page's code."""
    samples: Callable[[Trajectory], Trajectory] | None = None
    """Change of the returned trajectory."""
    releases: frozenset[Release] = frozenset({Release.LOOPING})
    reaches: frozenset[EffectKind] = frozenset({EffectKind.FORCE, EffectKind.CLOSURE})


def with_changed_fields(**arrays):
    """Return a function that changes fields of a trajectory; each argument is a function of the field."""
    return lambda run: dataclasses.replace(run, **{name: change(getattr(run, name)) for name, change in arrays.items()})


def with_changed_samples(change):
    """Return a function that changes every field that has one value or row per sample."""

    def of(run):
        fields = {f.name: getattr(run, f.name) for f in dataclasses.fields(run)}
        arrays = {name: value for name, value in fields.items() if isinstance(value, np.ndarray)}
        return dataclasses.replace(run, **{name: change(value) for name, value in arrays.items()})

    return of


def delayed_by_one_sample(run):
    """Replace every sample but the first by the one before it."""
    return dataclasses.replace(with_changed_samples(lambda a: np.concatenate([a[:1], a[:-1]]))(run), t=run.t)


def advanced_by_one_sample(run):
    """Replace every sample but the first by the one after it."""
    return dataclasses.replace(with_changed_samples(lambda a: np.concatenate([a[:1], a[2:], a[-1:]]))(run), t=run.t)


def noisy(run, seed):
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, 2e-4, run.light_position.shape)
    noise[0] = 0
    return dataclasses.replace(run, light_position=run.light_position + noise)


def slow_clock(run):
    """Take only every second step: half the speed, twice the time."""
    half = np.repeat(np.arange(len(run.t) // 2 + 1), 2)[: len(run.t)]
    return dataclasses.replace(with_changed_samples(lambda a: a[half])(run), t=run.t)


def rounded(values):
    return values.astype(np.float32).astype(float)


GRAVITY = 'gravity = p.coefficients["gravity"]'
FRICTION = "most = math.exp(friction * max(self.wrap_angle, 0.0))"
LIGHT_STRETCH = "light = free_length + p.rod_radius * self.wrap_angle - self.out"
COUNT = "self.wrap_angle += math.remainder(angle - self.wrap_angle, 2 * math.pi)"
START_OUT = "p.free_length + p.rod_radius * p.release_angle"
STEPS = "range(steps_per_sample(self.settings.time_step))"
READ = "return (*self.light, *self.light_velocity, *self.heavy, 0.0, self.heavy_speed, stretch, slip)"
FORCE = "self.force(self.time, x, y, vx, vy, self.heavy_speed)"
LOSSLESS, LOSSY = "follows_the_reference_without_losses", "follows_the_reference_past_the_halt_and_a_full_turn"
RELEASE_ACCELERATION, RELEASE_AGAINST_FRICTION = (
    "release_has_the_exact_acceleration",
    "release_against_friction_has_the_exact_acceleration",
)
ENERGY, START = "energy_is_kept_without_losses", "samples_every_millisecond_from_rest"
ATWOOD, CAPSTAN = "frictionless_vertical_release_is_an_atwood_machine", "vertical_release_obeys_the_capstan_law"


def effect_checks(*effects):
    """Return the names of the checks of ``effects``."""
    return tuple(f"{effect}_acts_as_in_the_reference" for effect in effects)


BUGS = (
    Bug(name="gravity doubled", code=((GRAVITY, GRAVITY + " * 2"),), caught_by=(RELEASE_ACCELERATION, ENERGY, LOSSLESS)),
    Bug(name="gravity a constant", code=((GRAVITY, "gravity = 9.81"),), caught_by=(RELEASE_AGAINST_FRICTION, LOSSY)),
    Bug(
        name="gravity 1 % too large",
        code=((GRAVITY, GRAVITY + " * 1.01"),),
        caught_by=("error_is_covered_by_refinement",),
    ),
    Bug(
        name="masses swapped",
        code=(
            ("fx / p.light_mass", "fx / p.heavy_mass"),
            ("fy / p.light_mass", "fy / p.heavy_mass"),
            ("heavy_fy / p.heavy_mass", "heavy_fy / p.light_mass"),
        ),
        caught_by=(RELEASE_ACCELERATION, ENERGY, LOSSLESS),
    ),
    Bug(
        name="light mass for both",
        code=(("heavy_fy / p.heavy_mass", "heavy_fy / p.light_mass"),),
        caught_by=(RELEASE_ACCELERATION, ENERGY),
    ),
    Bug(
        name="friction pushes",
        code=((FRICTION, FRICTION.replace("exp(", "exp(-")),),
        caught_by=(RELEASE_AGAINST_FRICTION, LOSSY),
    ),
    Bug(name="friction ignored", code=((FRICTION, "most = 1.0"),), caught_by=(RELEASE_AGAINST_FRICTION, LOSSY)),
    Bug(
        name="friction a tenth too strong",
        code=((FRICTION, FRICTION.replace("friction *", "1.1 * friction *")),),
        caught_by=(LOSSY,),
    ),
    Bug(
        name="turns lost by the friction",
        code=((FRICTION, FRICTION.replace("max(self.wrap_angle, 0.0)", "(self.wrap_angle % (2 * math.pi))")),),
        caught_by=(LOSSY,),
    ),
    Bug(
        name="turns lost by the winding",
        code=((COUNT, "self.wrap_angle = angle % (2 * math.pi)"),),
        caught_by=(LOSSY,),
    ),
    Bug(
        name="wrap angle handed back without its turns",
        samples=with_changed_fields(wrap_angle=lambda angle: angle % (2 * math.pi)),
        caught_by=("free_length_and_wrap_angle_are_those_of_the_position",),
    ),
    Bug(
        name="rod's diameter for its radius",
        code=(
            (LIGHT_STRETCH, LIGHT_STRETCH.replace("p.rod_radius", "2 * p.rod_radius")),
            (START_OUT, START_OUT.replace("p.rod_radius", "2 * p.rod_radius")),
        ),
        caught_by=(LOSSLESS, "string_keeps_its_length"),
    ),
    Bug(
        name="rod's radius forgotten by the tangent",
        code=(("x * x + y * y - p.rod_radius**2", "x * x + y * y"),),
        caught_by=(LOSSLESS,),
    ),
    Bug(
        name="light mass mirrored",
        samples=with_changed_fields(light_position=lambda x: x * (-1, 1), light_velocity=lambda v: v * (-1, 1)),
        caught_by=(START, RELEASE_ACCELERATION),
    ),
    Bug(
        name="masses' columns swapped",
        code=((READ, "return (*self.heavy, 0.0, self.heavy_speed, *self.light, *self.light_velocity, stretch, slip)"),),
        caught_by=(START,),
    ),
    Bug(
        name="velocities in mm/s",
        samples=with_changed_fields(light_velocity=lambda v: 1e3 * v, heavy_velocity=lambda v: 1e3 * v),
        caught_by=("velocity_is_the_rate_of_position", ENERGY),
    ),
    Bug(
        name="velocity of the heavy mass downwards",
        samples=with_changed_fields(heavy_velocity=np.negative),
        caught_by=("velocity_is_the_rate_of_position",),
    ),
    Bug(
        name="positions in cm",
        samples=with_changed_fields(light_position=lambda x: 100 * x, heavy_position=lambda x: 100 * x),
        caught_by=(START,),
    ),
    Bug(name="a sample late", samples=delayed_by_one_sample, caught_by=(RELEASE_ACCELERATION, RELEASE_AGAINST_FRICTION)),
    Bug(name="a sample early", samples=advanced_by_one_sample, caught_by=(RELEASE_ACCELERATION, RELEASE_AGAINST_FRICTION)),
    Bug(name="every second step lost", samples=slow_clock, caught_by=(RELEASE_ACCELERATION, LOSSLESS)),
    Bug(name="a step too many per sample", code=((STEPS, STEPS[:-1] + " + 1)"),), caught_by=(RELEASE_ACCELERATION, LOSSLESS)),
    Bug(
        name="one sample missing",
        samples=with_changed_samples(lambda a: np.delete(a, 70, axis=0)),
        caught_by=(START, "runs_to_its_end"),
    ),
    Bug(
        name="one sample missing, times closed up",
        samples=lambda run: dataclasses.replace(with_changed_samples(lambda a: np.delete(a, 70, axis=0))(run), t=run.t[:-1]),
        caught_by=(START, "runs_to_its_end", "velocity_is_the_rate_of_position"),
    ),
    Bug(
        name="ends early and says finished",
        samples=with_changed_samples(lambda a: a[:-20]),
        caught_by=(START, "runs_to_its_end"),
    ),
    Bug(
        name="y from the rod's top",
        samples=with_changed_fields(light_position=lambda x: x - (0, 0.02), heavy_position=lambda x: x - (0, 0.02)),
        caught_by=(START,),
    ),
    Bug(
        name="heavy mass below the rod's centre",
        samples=with_changed_fields(heavy_position=lambda x: x * (0, 1)),
        caught_by=(START, "heavy_mass_falls_straight_down"),
    ),
    Bug(
        name="heavy mass drifts aside",
        samples=lambda run: dataclasses.replace(
            run, heavy_position=run.heavy_position + np.column_stack([0.02 * run.t, 0 * run.t])
        ),
        caught_by=("heavy_mass_falls_straight_down",),
    ),
    Bug(
        name="hanging length ignored",
        code=(("[p.rod_radius, -p.hanging_length]", "[p.rod_radius, -0.03]"),),
        caught_by=(LOSSY,),
    ),
    Bug(
        name="string stretches",
        code=(("stiffness=2e4, damping=14.0", "stiffness=2e2, damping=1.4"),),
        caught_by=("string_keeps_its_length", LOSSLESS),
    ),
    Bug(
        name="string pushes what is slack",
        code=(("if now > 0 else 0.0", ""), ("max(pull, 0.0)", "pull")),
        releases=frozenset({Release.HELD}),
        caught_by=("a_slack_string_pulls_nothing",),
    ),
    Bug(name="stuck string creeps", code=(("slid = 0.0  # sticks", "slid = 1e-6  # sticks"),), caught_by=(LOSSY,)),
    Bug(
        name="static friction ignored",
        code=(('"kinetic_friction" if self.slides else "static_friction"', '"kinetic_friction"'),),
        releases=frozenset({Release.LOOPING, Release.VERTICAL}),
        caught_by=("static_friction_holds_what_kinetic_friction_would_not",),
    ),
    Bug(
        name="drag ignored",
        code=((FORCE + " if self.force else (0.0, 0.0, 0.0)", "(0.0, 0.0, 0.0)"),),
        caught_by=effect_checks("light_drag", "wind"),
    ),
    Bug(name="drag doubled", code=((FORCE, f"(2 * f for f in {FORCE})"),), caught_by=effect_checks("light_drag", "heavy_drag")),
    Bug(
        name="forces of x and y swapped",
        code=(("fx, fy, heavy_fy = self.force", "fy, fx, heavy_fy = self.force"),),
        caught_by=effect_checks("side_force"),
    ),
    Bug(
        name="forces of the heavy mass ignored",
        code=(("fx, fy, heavy_fy = " + FORCE, f"fx, fy, heavy_fy = (*{FORCE}[:2], 0.0)"),),
        caught_by=effect_checks("heavy_drag", "heavy_linear_drag"),
    ),
    Bug(
        name="velocities ignored by the forces",
        code=((FORCE, "self.force(self.time, x, y, 0.0, 0.0, 0.0)"),),
        caught_by=effect_checks("light_linear_drag"),
    ),
    Bug(
        name="push at release declared and ignored",
        reaches=FORCES_AND_RELEASE,
        caught_by=effect_checks("push_across", "push_along"),
    ),
    Bug(
        name="laws of the string declared and ignored",
        reaches=frozenset({EffectKind.FORCE, EffectKind.STRING_LAW}),
        caught_by=effect_checks("friction_per_speed", "friction_per_wrap", "string_on_string"),
    ),
    Bug(
        name="properties declared and ignored",
        reaches=frozenset({EffectKind.FORCE, EffectKind.PROPERTY}),
        caught_by=effect_checks(
            "string_mass", "string_thickness", "heavy_swing", "out_of_plane", "turning_rod", "string_stretch"
        ),
    ),
    Bug(
        name="positions rounded to single precision",
        samples=with_changed_fields(light_position=rounded, heavy_position=rounded),
        caught_by=(START,),
    ),
    Bug(name="noise of 0.2 mm", samples=lambda run: noisy(run, 1), caught_by=("velocity_is_the_rate_of_position",)),
    Bug(name="another noise each time", samples=lambda run: noisy(run, None), caught_by=("is_deterministic",)),
    Bug(
        name="clamp of the held release open",
        code=(("if p.release is not Release.HELD:", "if True:"),),
        releases=frozenset({Release.HELD}),
        caught_by=("held_pendulum_swings_to_the_other_side",),
    ),
    Bug(
        name="string of the drop still there",
        code=(("if p.release is not Release.DROP:", "if True:"),),
        releases=frozenset({Release.DROP}),
        caught_by=("drop_is_free_fall",),
    ),
    Bug(
        name="masses swapped, vertical",
        code=(("fy / p.light_mass", "fy / p.heavy_mass"), ("heavy_fy / p.heavy_mass", "heavy_fy / p.light_mass")),
        releases=frozenset({Release.VERTICAL}),
        caught_by=(ATWOOD, CAPSTAN),
    ),
)

NOT_CAUGHT = (
    Bug(name="gravity 0.01 % too large", code=((GRAVITY, GRAVITY + " * 1.0001"),), caught_by=()),
    Bug(
        name="a law that is fed in called the engine's own",
        code=(("friction_law=Supply(by=Supplier.ADAPTER", "friction_law=Supply(by=Supplier.ENGINE"),),
        caught_by=(),
    ),
)
"""Bugs that no check sees.

The first moves a mass by 0.01 mm in 0.15 s, less than the engine itself errs by; of the second nothing shows in a run, so that
it takes a reader of the adapter.
"""


def planted(bug):
    """Return the engine of the page with ``bug`` in it."""
    source = SOURCE
    for old, new in bug.code:
        assert source.count(old) == 1, f"the page has {source.count(old)} of {old!r}"
        source = source.replace(old, new)
    (engine,) = module("looping_spring", source).engines(Profile.QUICK)
    engine.abilities = dataclasses.replace(engine.abilities, releases=bug.releases, effect_kinds=bug.reaches)
    return engine if bug.samples is None else Handed(engine, bug.samples)


class Handed:
    """An engine whose samples are changed before they are returned."""

    def __init__(self, engine, change):
        self.engine, self.change = engine, change
        self.name, self.variant, self.profile = engine.name, engine.variant, engine.profile
        self.abilities, self.settings = engine.abilities, engine.settings
        self.with_settings, self.studies = engine.with_settings, engine.studies

    def simulate(self, scenario, record=None):
        return self.change(self.engine.simulate(scenario))


def verdicts(engine, names):
    """Return check -> its failure message for ``engine``, empty if it passes."""
    engine = CachedEngine(engine)
    said = {}
    for name in names:
        assert not skip_reason(BY_NAME[name], engine), name
        try:
            BY_NAME[name](engine)
            said[name] = ""
        except AssertionError as error:
            said[name] = str(error) or "it does not hold"
    return said


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name.replace(" ", "_"))
def test_a_planted_bug_is_caught_by_each_check_that_should(bug):
    missed = [name for name, said in verdicts(planted(bug), bug.caught_by).items() if not said]
    assert bug.caught_by
    assert not missed


@pytest.mark.parametrize("bug", NOT_CAUGHT, ids=lambda bug: bug.name.replace(" ", "_"))
def test_what_no_check_catches(bug):
    names = [name for name, check in BY_NAME.items() if not skip_reason(check, planted(bug))]
    assert not any(verdicts(planted(bug), names).values())


def test_an_engine_of_no_law_is_not_asked_for_one():
    engine = planted(BUGS[0])
    nobody = Supply(by=Supplier.NOBODY, how="none")
    supplies = dataclasses.replace(engine.abilities.supplies, friction_law=nobody, drag=nobody, stick_slip=nobody)
    engine.abilities = dataclasses.replace(engine.abilities, supplies=supplies, releases=frozenset(Release))
    why = {name: skip_reason(check, engine) for name, check in BY_NAME.items()}
    assert why[LOSSY] == why[CAPSTAN] == "nobody supplies its friction law"
    assert why["light_drag_acts_as_in_the_reference"] == "nobody supplies its drag"
    assert why["runs_to_its_end"] == why[LOSSLESS] == why[ATWOOD] == ""


def test_the_page_says_how_many_are_caught():
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"Of {len(BUGS) + len(NOT_CAUGHT)} bugs seeded into the adapter above" in text
    assert f"it catches {len(BUGS)}, each by" in text

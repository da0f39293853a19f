"""What is dumped loads back equal, whatever it is; and what a file means."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from looping_pendulum.errors import ScenarioError
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient, Effect, EffectKind
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios import dump, json_schema, load, load_text
from looping_pendulum.scenarios.metrics import METRICS
from looping_pendulum.scenarios.quantities import FILE_KEYS, file_key
from looping_pendulum.scenarios.scenario import (
    PROFILES,
    Inference,
    MeasuredTable,
    Scenario,
    Tolerance,
)

from .test_errors import GOOD

lengths = st.floats(1e-4, 1e2)
words = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)


@st.composite
def parameter_sets(draw):
    friction = draw(st.floats(0, 5))
    radius = draw(lengths)
    light_radius = draw(st.sampled_from([0.0, 0.005, 0.0123456789]))
    touching = max(math.sqrt(light_radius**2 + 2 * light_radius * radius), radius / 3)
    return Parameters(
        light_mass=draw(st.floats(1e-5, 1e3)),
        heavy_mass=draw(st.floats(1e-5, 1e3)),
        rod_radius=radius,
        free_length=touching + draw(lengths),
        release_angle=draw(st.floats(1e-3, 6.28)),
        hanging_length=draw(lengths),
        light_radius=light_radius,
        release=draw(st.sampled_from(list(Release))),
        coefficients={
            "kinetic_friction": friction,
            "static_friction": friction + draw(st.sampled_from([0.0, 0.1])),
            "light_drag": draw(st.floats(0, 1)),
            "heavy_drag": draw(st.floats(0, 1)),
            "string_drag": draw(st.floats(0, 1)),
            "gravity": draw(st.floats(0, 100)),
        },
    )


tolerances = st.builds(
    Tolerance,
    # No key of a file is in such brackets
    engine=st.sampled_from(["pymunk:chain", "mine:own engine", "x"]) | words.filter(lambda name: name[:1] + name[-1:] != "<>"),
    profile=st.sampled_from(PROFILES),
    metric=st.sampled_from(list(METRICS)),
    limit=st.floats(0, 1e6),
    reason=words,
    expected_failure=words,
)
scenarios = st.builds(
    Scenario,
    name=st.just("any"),
    title=words,
    description=words,
    parameters=parameter_sets(),
    duration=st.floats(1e-6, 3600),
    tolerances=st.lists(tolerances, max_size=4, unique_by=lambda t: (t.engine, t.profile, t.metric)).map(tuple),
    inferred=st.lists(
        st.builds(
            Inference,
            parameters=st.lists(st.sampled_from(list(FILE_KEYS.values())), min_size=1, max_size=3).map(tuple),
            how=words,
            script=words,
        ),
        max_size=2,
    ).map(tuple),
    measured=st.none()
    | st.builds(
        MeasuredTable,
        file=st.just("paper/trial.csv"),
        sha256=st.text("0123456789abcdef", min_size=64, max_size=64),
        source=words,
    ),
)


@settings(max_examples=150, deadline=None)
@given(scenarios)
def test_dump_loads_back_to_an_equal_scenario(scenario):
    assert load_text(dump(scenario), "any.yaml") == scenario


def test_dump_writes_units_as_people_do():
    text = dump(load("ten_to_one"))
    for line in (
        "mass: 10 g",
        "radius: 6.25 mm",
        "angle: 113.08 deg",
        "free_length: 58.08 cm",
        "gravity: 9.81 m/s^2",
        "duration: 1.05 s",
    ):
        assert line in text


def test_values_are_those_that_python_would_have_read():
    p = load_text(GOOD, "my").parameters
    assert (p.light_mass, p.heavy_mass, p.rod_radius, p.free_length) == (0.01, 0.1, 0.00625, 0.58)
    assert p.release_angle == math.radians(112)
    assert p.coefficients["light_drag"] == 1e-3


def test_what_is_left_out_keeps_the_models_default():
    p = load_text(GOOD, "my").parameters
    own = Parameters(light_mass=1, heavy_mass=1, rod_radius=1, free_length=1, release_angle=1)
    assert (p.hanging_length, p.light_radius, p.release) == (own.hanging_length, own.light_radius, own.release)
    assert p.coefficients["gravity"] == own.coefficients["gravity"]
    assert p.coefficients["static_friction"] == p.coefficients["kinetic_friction"] == 0.3


@pytest.mark.parametrize(("density", "rho"), [("", 1.2), (", air_density: 1 kg/m^3", 1.0)])
def test_drag_by_shape_is_half_c_rho_a(density, rho):
    p = load_text(GOOD.replace("1e-3 kg/m", f"{{shape_factor: 0.5, area: 4 cm^2{density}}}"), "my").parameters
    assert p.coefficients["light_drag"] == 0.5 * 0.5 * rho * 4e-4


def test_a_file_may_have_a_byte_order_mark_and_windows_line_ends(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    loaded = load(path)
    assert loaded.name == "mine"
    assert loaded == load(str(path))
    assert loaded.parameters == load_text(GOOD, "my").parameters


def test_text_that_looks_like_a_number_or_a_truth_value_stays_text():
    assert load_text(GOOD.replace("A trial", "1:30"), "my").title == "1:30"
    assert load_text(GOOD.replace("A trial", "no"), "my").title == "no"


@pytest.fixture
def wind(monkeypatch):
    """An effect that the library does not have yet."""
    coefficient = Coefficient(
        name="wind_speed", unit="m/s", default=0.0, null=0.0, bounds=(-9.0, 9.0), meaning="speed of a draught"
    )
    effect = Effect(
        name="wind", kind=EffectKind.FORCE, formula="", source="test", acts_on="", depends_on=(), coefficients=(coefficient,)
    )
    monkeypatch.setitem(effect_library.EFFECTS, "wind", effect)
    monkeypatch.setitem(effect_library.COEFFICIENTS, "wind_speed", coefficient)


@pytest.mark.usefixtures("wind")
def test_an_effect_added_to_the_library_needs_no_change_here():
    assert file_key("wind_speed") == "effects.wind_speed"
    extra = "effects: {wind_speed: 36 cm/s}\ninferred:\n- {parameters: [effects.wind_speed], how: felt}\n"
    scenario = load_text(GOOD + extra, "my")
    assert scenario.parameters.coefficients["wind_speed"] == 0.36
    assert load_text(dump(scenario), "my") == scenario
    assert "wind_speed" in json_schema()["properties"]["effects"]["properties"]
    for text, line in [
        ("36 cm", "expected a speed, got '36 cm'"),
        ("10 m/s", "expected a speed from -9 m/s to 9 m/s, got '10 m/s'"),
    ]:
        with pytest.raises(ScenarioError) as caught:
            load_text(f"{GOOD}effects: {{wind_speed: {text}}}\n", "my.yaml")
        assert str(caught.value).startswith(f"my.yaml:11: effects.wind_speed: {line}; write for example '1 m/s'")
    with pytest.raises(ScenarioError, match="effects.wind_sped: found an unknown key.*did you mean 'wind_speed'"):
        load_text(GOOD + "effects: {wind_sped: 1 m/s}\n", "my.yaml")

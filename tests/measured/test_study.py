"""Study files: what they say, what is wrong with bad ones, and that a written one reads back the same."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from looping_pendulum.discrepancy.candidates import candidates
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.measurement import predict
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.study import Estimate, Trial, read_files, refuse_seen_points
from looping_pendulum.measured.study_file import WRONG
from looping_pendulum.measured.study_io import StudyError, dump, load, load_text
from looping_pendulum.reference_ode.effects import LIBRARY, EffectKind
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.units import show
from tests.discrepancy.real_data import real
from tests.fuzz.judging import time_limit

STUDY = """
title: Two trials
apparatus:
  light: {mass: 10 g +/- 0.05 g}
  heavy: {mass: 100 g +/- 0.5 %}
  rod: {radius: 6.25 mm +/- 1 %}
effects:
  capstan: free
  light_drag: free from 2e-3 kg/m
  heavy_drag: 1e-3 kg/m
  string_drag: 1e-3 kg/m^2 +/- 50 %
trials:
  - name: first
    files: {light: a.csv, heavy: b.csv}
    frame_rate: 240 Hz
    clip_rate: 30 Hz
    release: {kind: looping, angle: (112 +/- 0.5) deg, free_length: 58 cm +/- 1 mm, hanging_length: 30 mm ± 1 mm}
  - file: c.csv
    tracks: {light: mass A, heavy: mass B}
    heavy: {mass: 60 g +/- 0.5 %}
    release: {angle: 100 deg +/- 0.5 deg, free_length: 58 cm +/- 1 mm}
    camera: {scale: 1 +/- 1 %}
  - name: test
    file: d.csv
    held_out: true
    mirrored: true
    heavy: {mass: 60 g +/- 0.5 %}
    release: {angle: 90 deg +/- 0.5 deg, free_length: 58 cm +/- 1 mm}
limits:
  release_angle: [60 deg, 130 deg]
  mass_ratio: [2, 10]
  releases: [looping, held]
"""
SHARED = {"kinetic_friction", "light_drag", "string_drag", "light_mass", "rod_radius"}
FREE = {"first.release_angle", "first.free_length", "first.hanging_length"}


@pytest.fixture(scope="module")
def study():
    return load_text(STUDY, "two.yaml")


def test_what_was_measured(study):
    assert study.apparatus["heavy_mass"] == Estimate(value=0.1, sigma=0.0005)
    assert study.apparatus["rod_radius"] == Estimate(value=0.00625, sigma=6.25e-5)
    assert study.effects["kinetic_friction"] == Estimate(value=0.3, free=True)
    assert study.effects["light_drag"] == Estimate(value=0.002, free=True)
    assert study.effects["heavy_drag"] == Estimate(value=0.001)
    assert study.effects["string_drag"] == Estimate(value=0.001, sigma=0.0005)
    assert set(study.effects) == {"kinetic_friction", "light_drag", "heavy_drag", "string_drag"}
    first, second, test = study.trials
    assert first.estimates["release_angle"] == Estimate(value=math.radians(112), sigma=math.radians(0.5))
    assert first.estimates["hanging_length"] == Estimate(value=0.03, sigma=0.001)
    assert first.files == (("a.csv", {"light": ""}), ("b.csv", {"heavy": ""}))
    assert (first.frame_rate, first.clip_rate) == (240.0, 30.0)
    assert (second.name, second.files[0][1]) == ("c", {"light": "mass A", "heavy": "mass B"})
    assert second.estimates["hanging_length"].free
    assert study.training == (first, second)
    assert study.held_out == (test,)
    assert study.limits.releases == (Release.LOOPING, Release.HELD)
    assert study.limits.release_angle == pytest.approx((math.radians(60), math.radians(130)))


def test_a_parameter_is_shared_by_the_trials_that_use_the_same_part(study):
    free = {u.name: u for u in study.free_parameters()}
    assert SHARED | FREE < set(free)
    assert "heavy_drag" not in free
    assert free["rod_radius"].trials == ("first", "c")
    assert free["heavy_mass"].trials == ("first",)
    assert free["c.heavy_mass"].trials == ("c",)
    assert free["light_drag"].sigma is None
    assert free["light_drag"].bounds == (0.0, 1.0)
    everything = {u.name: u for u in study.free_parameters(study.trials)}
    assert everything["c.heavy_mass"].trials == ("c", "test")  # the same 60 g
    assert "test.heavy_mass" not in everything


def test_parameters_of_a_trial(study):
    first, second, test = study.trials
    nominal = study.parameters({}, first)
    assert (nominal.light_mass, nominal.heavy_mass, nominal.rod_radius) == (0.01, 0.1, 0.00625)
    assert nominal.coefficients["kinetic_friction"] == nominal.coefficients["static_friction"] == 0.3
    values = {"kinetic_friction": 0.34, "heavy_mass": 0.11, "c.heavy_mass": 0.061, "first.free_length": 0.57, "gravity": 9.8}
    assert study.parameters(values, first).heavy_mass == 0.11
    assert study.parameters(values, first).free_length == 0.57
    assert study.parameters(values, second).heavy_mass == study.parameters(values, test).heavy_mass == 0.061
    assert study.parameters(values, second).free_length == 0.58
    assert study.parameters(values, test).coefficients["gravity"] == 9.8
    assert study.parameters(values, test).coefficients["static_friction"] == 0.34
    assert study.parameters(values, test).release_angle == math.radians(90)


def test_fit_names_what_may_change():
    study = load_text(STUDY.replace("trials:\n", "fit: [kinetic_friction, light_drag, release_angle]\ntrials:\n"), "two.yaml")
    wanted = ["kinetic_friction", "light_drag", "first.release_angle", "c.release_angle"]
    assert [u.name for u in study.free_parameters()] == wanted


def test_a_written_study_reads_back_the_same(study):
    text = dump(study)
    assert load_text(text, "two.yaml") == study
    assert dump(load_text(text, "two.yaml")) == text


NOT_DECLARED_AS_EFFECTS = {
    "light_mass": "measure light.mass again",
    "rod_radius": "measure rod.radius again",
    "free_length": "measure release.free_length again",
    "gravity": "write for example 'gravity: free'",
    "kinetic_friction": "write for example 'capstan: free'",
    "heavy_drag": "write for example 'heavy_drag: free'",
}
"""Values that `identify` may call wrong -> what a study says that declares one of them as an effect."""


def test_a_study_takes_each_name_that_identify_may_print():
    """A report advised `string_density: free` under `effects`, which was refused: the key was string_mass, and wind, ..."""
    declared = load_text(STUDY, "two.yaml")
    bare = replace(declared, effects={})
    cameras = [name for name, c in CAMERA.items() if c.candidate_reach]
    listed = {c.name: c for study in (declared, bare) for c in candidates(study, (), cameras)}
    assert {"string_density", "push_sideways", "static_friction", "string_compliance", "wind_speed", "tilt"} <= set(listed)
    before, after = STUDY[: STUDY.index("effects:")], STUDY[STUDY.index("trials:") :]

    def declaring(effect, value):
        return load_text(f"{before}effects: {{{effect}: free from {value}}}\n{after}", "two.yaml")

    for name, c in listed.items():
        value = show(c.null, c.unit)
        if c.acts_on == "camera":
            trial = f"    camera: {{{name}: free from {value}}}\n    held_out: true\n"
            assert name in load_text(STUDY.replace("    held_out: true\n", trial), "two.yaml").trials[2].camera
            with pytest.raises(StudyError, match="an error of the camera"):
                declaring(name, value)
        elif c.kind == "wrong value":
            with pytest.raises(StudyError) as error:
                declaring(name, value)
            parameter = name.removeprefix(WRONG)
            assert NOT_DECLARED_AS_EFFECTS.get(parameter, f"write for example '{parameter}: free'") in str(error.value)
        else:
            assert name in declaring(name, value).effects
            for companion in c.companions:
                value = show(companion.default, companion.unit)
                assert companion.name in declaring(companion.name, value).effects


def test_no_effect_has_a_second_key():
    """The name of an effect whose coefficient is named otherwise is refused with that name."""
    for effect in LIBRARY:
        keys = [c.name for c in effect.coefficients]
        if effect.name in (*keys, "capstan") or effect.kind is EffectKind.CLOSURE:
            continue
        with pytest.raises(StudyError, match=f"needed its key '{keys[0]}'"):
            load_text(STUDY.replace("light_drag: free", f"{effect.name}: free"), "two.yaml")


positive = st.floats(1e-6, 1e3)


@settings(max_examples=60, deadline=None)
@given(mass=positive, error=st.floats(1e-9, 6.28), angle=st.floats(0.01, 6.28), friction=st.floats(0, 5), rate=positive)
def test_any_numbers_read_back_exactly(study, mass, error, angle, friction, rate):
    estimates = {**study.trials[0].estimates, "release_angle": Estimate(value=angle, sigma=error)}
    changed = replace(
        study,
        apparatus={**study.apparatus, "light_mass": Estimate(value=mass, sigma=min(error, 999 * mass))},
        effects={**study.effects, "kinetic_friction": Estimate(value=friction, free=True)},
        trials=(replace(study.trials[0], estimates=estimates, frame_rate=rate), *study.trials[1:]),
    )
    assert load_text(dump(changed), "two.yaml") == changed


BAD = [
    ("10 g +/- 0.05 g", "10 g +/- 0.05 mm", "apparatus.light.mass: found '0.05 mm' after '+/-', needed a standard error"),
    ("10 g +/- 0.05 g", "10 mm", "apparatus.light.mass: expected a mass"),
    ("10 g +/- 0.05 g", "10", "got '10' (the unit is missing)"),
    ("10 g +/- 0.05 g", "10 g +/- 0 g", "apparatus.light.mass: found a standard error of '0 g', needed one above 0"),
    (
        "100 deg +/- 0.5 deg",
        "100 deg +/- 5e299 deg",
        "trials[1].release.angle: found a standard error of '5e299 deg', needed at most 360 deg, its whole range; if "
        "nothing is known of the value, write 'free from 100 deg'",
    ),
    ("10 g +/- 0.05 g", "(10 +/- 10001) g", "found a standard error of '10001 g', needed at most 1000 times the value; "),
    ("10 g +/- 0.05 g", "1e306 kg +/- 1e300 %", "found a standard error of '1e300 %', needed at most 1000 times the value; "),
    (
        "scale: 1 +/- 1 %",
        "clock_offset: 0 s +/- 121 s",
        "found a standard error of '121 s', needed at most 120 s, its whole range",
    ),
    ("10 g +/- 0.05 g", "10 g +/- 1 g +/- 2 g", "apparatus.light.mass: expected one '+/-'"),
    ("10 g +/- 0.05 g", "free", "apparatus.light.mass: found 'free' without a start"),
    (
        "{mass: 10 g +/- 0.05 g}",
        "{mas: 10 g}",
        "apparatus.light.mas: found an unknown key, needed one of: mass, radius; did you",
    ),
    ("{mass: 10 g +/- 0.05 g}", "10 g", "apparatus.light: expected a group of keys (mass, radius), got '10 g'"),
    ("light_drag: free", "light_darg: free", "effects.light_darg: found an unknown effect, needed one of: gravity, capstan"),
    ("light_drag: free", "string_mass: free", "effects.string_mass: found an unknown effect, needed its key 'string_density'"),
    ("light_drag: free", "turning_rod: free", "needed its key 'rod_mobility' and 'bearing_friction', as `identify`"),
    ("light_drag: free", "wrong_free_length: free", "measure release.free_length again, and write there for example "),
    ("light_drag: free", "tilt: free", "as it is an error of the camera; write 'camera: {tilt: free from 0"),
    ("capstan: free", "capstan: free\n  kinetic_friction: 0.3", "found a second value of kinetic_friction, needed one"),
    ("capstan: free", "capstan: {kinetic: free}", "effects.capstan.kinetic: found an unknown key"),
    ("capstan: free", "capstan: {kinetic_friction: 1 kg}", "effects.capstan.kinetic_friction: expected a plain number"),
    ("held_out: true", "held_out: ja", "trials[2].held_out: expected true or false, got 'ja'; write 'true' or 'false'"),
    (
        "{mass: 10 g +/- 0.05 g}",
        "{mass: 10,5 g +/- 0,05 g}",
        "apparatus.light.mass: found a comma inside '10,5 g +/- 0,05 g', needed a decimal point; write '10.5 g +/- 0.05 g'",
    ),
    ("file: d.csv", "file: #4.csv", "trials[2].file: expected text, got nothing; "),
    ("file: d.csv", f"file: {'_' * 600}", "which is not a valid file name; needed one"),  # ended in an OSError
    ("file: d.csv", "file: #4.csv", "'#' begins a comment: put a value that has it in quotes"),
    ("{light: mass A, heavy: mass B}", "{light: ball #1, heavy: ball #2}", "'#' begins a comment: put a value that has it in"),
    ("240 Hz", "240", "trials[0].frame_rate: expected a quantity in Hz"),
    ("kind: looping", "kind: loping", "did you mean 'looping'?"),
    ("    tracks:", "    track:", "trials[1].track: found an unknown key"),
    (
        "{light: a.csv, heavy: b.csv}",
        "{ligt: a.csv}",
        "trials[0].files.ligt: found an unknown key, needed one of: light, heavy",
    ),
    ("    file: d.csv\n", "", "trials[2].file: found nothing, needed one of them"),
    ("name: first", "file: e.csv", "trials[0].file: found both 'file' and 'files', needed one of them"),
    ("name: test", "name: first", "trials[2].name: found a second trial 'first'"),
    ("[looping, held]", "looping", "limits.releases: expected a list, got 'looping'"),
    ("[60 deg, 130 deg]", "[130 deg, 60 deg]", "limits.release_angle: found the lowest value above the highest"),
    ("title: Two trials\n", "", "title: missing, needed text"),
    (
        "  rod: {radius: 6.25 mm +/- 1 %}\n",
        "",
        "first: a looping release needed 'apparatus.rod.radius'; write for example 'radius",
    ),
    ("100 deg +/- 0.5 deg", "100 rad", "trials[1].release.angle: expected an angle above 0 up to 360 deg"),
    ("angle: 100 deg +/- 0.5 deg, ", "", "c: a looping release needed 'release.angle'"),
    ("kind: looping", "kind: vertical", "trials[0].release.angle: found an angle, needed none"),
    ("trials:\n", "fit: [kinetic_frction]\ntrials:\n", "did you mean 'kinetic_friction'?"),
    ("trials:\n", "fit: [light_mass]\ntrials:\n", "found 'free', but 'fit' leaves it out"),
    ("58 cm +/- 1 mm, hang", "1 mm, hang", "first: free_length: found 0.001 m, but the light mass already touches the rod"),
    ("apparatus:\n", "apparatus:\n\t", "found a tab, needed spaces"),
    ("scale: 1 +/- 1 %", "zoom: 1", "trials[1].camera.zoom: found an unknown key, needed one of: origin_x"),
    ("{scale: 1 +/- 1 %}", "1 %", "trials[1].camera: expected a group of keys (origin_x, origin_y, scale, tilt,"),
    ("scale: 1 +/- 1 %", "perspective_x: 3 m", "trials[1].camera.perspective_x: expected a quantity in 1/m, got '3 m'"),
    ("scale: 1 +/- 1 %", "distortion: 5 1/m^2", "trials[1].camera.distortion: "),
    # Names of fields that are no keys, by themselves and as the models write them
    ("name: first", "estimates: {light_mass: 10 g}", "trials[0].estimates: found an unknown key, needed one of: file, files, "),
    ("name: first", "<estimates>: {}", "two.yaml:13: found the unknown key '<estimates>', needed one without brackets"),
    ("title: Two trials", "title: Two trials\nfolder: /", "folder: found an unknown key, needed one of: title, apparatus, "),
    ("trials:\n", "fit: []\ntrials:\n", "fit: found an empty list, needed at least one entry"),
    ("240 Hz", "240 Hz\n    run: [1]", "trials[0].run: expected text, got a list"),
]


@pytest.mark.parametrize("word", ["true", "yes", "On", "TRUE"])
def test_every_word_of_yaml_for_true_is_read(word, study):
    assert load_text(STUDY.replace("held_out: true", f"held_out: {word}"), "two.yaml") == study


def test_a_file_whose_name_is_cut_at_the_comment_sign_is_asked_for_in_quotes(tmp_path):
    (tmp_path / "clip #4.csv").touch()
    with pytest.raises(StudyError, match=r"trials\[2\].file: found 'clip', .* in quotes, 'clip #4.csv'$"):
        load_text(STUDY.replace("file: d.csv", "file: clip #4.csv"), "two.yaml", tmp_path)
    assert load_text(STUDY.replace("file: d.csv", "file: d.csv  # the last one"), "two.yaml", tmp_path).trials[2].name == "test"


@pytest.mark.parametrize(("old", "new", "wanted"), BAD)
def test_a_bad_study_gives_one_clear_line(old, new, wanted):
    assert old in STUDY
    with pytest.raises(StudyError) as caught:
        load_text(STUDY.replace(old, new, 1), "two.yaml")
    message = str(caught.value)
    assert wanted in message, message
    assert message.startswith("two.yaml:")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("old", "new", "sigma"),
    [
        ("100 deg +/- 0.5 deg", "100 deg +/- 360 deg", 2 * math.pi),
        ("10 g +/- 0.05 g", "(10 +/- 10000) g", 10.0),
        ("scale: 1 +/- 1 %", "clock_offset: 0 s +/- 10 s", 10.0),
    ],
)
def test_an_error_as_large_as_the_range_is_read(old, new, sigma):
    assert old in STUDY
    study = load_text(STUDY.replace(old, new, 1), "two.yaml")
    estimates = [*study.apparatus.values(), *(e for t in study.trials for e in (*t.estimates.values(), *t.camera.values()))]
    assert sigma in [e.sigma for e in estimates]


def test_only_held_out_trials_teach_nothing():
    text = STUDY.replace("    frame_rate: 240 Hz\n", "    held_out: true\n").replace(
        "    tracks:", "    held_out: true\n    tracks:"
    )
    with pytest.raises(StudyError, match="found only held-out trials"):
        load_text(text, "two.yaml")


def test_the_topmost_error_is_named_first_and_an_unknown_key_before_all():
    two = STUDY.replace("240 Hz", "240").replace("100 deg +/- 0.5 deg", "100")
    with pytest.raises(StudyError, match=r"two.yaml:15: trials\[0\].frame_rate: "):
        load_text(two, "two.yaml")
    with pytest.raises(StudyError, match=r"trials\[2\].mirored: found an unknown key, .*; did you mean 'mirrored'"):
        load_text(two.replace("mirrored", "mirored"), "two.yaml")


def test_what_the_program_makes_is_in_si(study):
    trial = replace(study.trials[0], frame_rate=120.0)
    assert (trial.frame_rate, trial.release, trial.estimates) == (120.0, Release.LOOPING, study.trials[0].estimates)
    assert trial.in_mid_swing is False
    with pytest.raises(AttributeError):
        trial.frame_rate = 60.0


def test_many_trials_take_time_in_proportion():
    """Every trial was checked by the parameters of all trials: 800 of them took 20 s."""
    head, tail = STUDY[: STUDY.index("trials:")], "release: {angle: 112 deg, free_length: 58 cm}}\n"
    trials = "".join(f"- {{name: t{i}, file: a, {tail}" for i in range(800))
    with time_limit(10.0):
        assert len(load_text(f"{head}trials:\n{trials}", "two.yaml").trials) == 800


def test_errors_of_files(tmp_path):
    with pytest.raises(StudyError, match="none.yaml: cannot be read"):
        load(tmp_path / "none.yaml")
    with pytest.raises(StudyError, match="found a folder, needed a file"):
        load(tmp_path)
    with pytest.raises(StudyError, match="needed a study"):
        load_text("", "two.yaml")
    assert issubclass(StudyError, HarnessError)


def test_trials_are_read_from_the_study_s_folder(tmp_path):
    (tmp_path / "two.yaml").write_text(STUDY, encoding="utf-8")
    head = ",mass A,,\nt,x,y,\n"
    (tmp_path / "a.csv").write_text(head + "0,-.5,-.2,\n.033333,-.5,-.21,\n")
    (tmp_path / "b.csv").write_text(head + "0,.006,-.03,\n.033333,.006,-.03,\n")
    (tmp_path / "d.csv").write_text("t,light_x,light_y\n0,.5,-.2\n.004,.5,-.2\n")
    study = load(tmp_path / "two.yaml")
    observations = read_files(study.folder, study.trial("first"))
    assert {c.name for c in observations.channels} == {"light_x", "light_y", "heavy_x", "heavy_y"}
    assert observations.channel("light_x").t == pytest.approx([0, 1 / 240], rel=1e-4)
    assert read_files(study.folder, study.trial("test")).channel("light_x").value.tolist() == [-0.5, -0.5]  # mirrored
    with pytest.raises(DataError, match=r"c.csv: cannot be read"):
        read_files(study.folder, study.trial("c"))
    priors = study.camera_priors(study.trial("first"), observations)
    # Of tracked points, all of the camera matters but what only films that were tracked here have
    assert set(priors) == set(CAMERA) - {"rate_offset", "readout", "heavy_offset_x"}


def test_a_drop_needs_only_what_falls():
    path = real("falling_balls/bowling_ball.csv")
    text = f"""
title: Bowling ball
apparatus: {{heavy: {{mass: 81 oz +/- 1 %}}}}
effects: {{gravity: 9.81 m/s^2}}
trials:
  - {{file: {path.name}, name: one, run: 1, release: {{kind: drop}}}}
  - {{file: {path.name}, name: two, run: 2, release: {{kind: drop}}, held_out: true}}
"""
    study = load_text(text, "balls.yaml", Path(path).parent)
    assert load_text(dump(study), "balls.yaml") == study
    one = study.trials[0]
    observations = read_files(study.folder, one)
    priors = study.camera_priors(one, observations)
    assert set(priors) == {"origin_y", "scale", "clock_offset", "clock_ratio"}
    assert [u.name for u in study.free_parameters()] == ["heavy_mass"]
    # Gravity alone, with nothing but the time of release looked for: the near-null control misses by some tenths of a metre.
    height = observations.channel("height")

    def miss(offset):
        camera = Camera(origin_y=priors["origin_y"].value, clock_offset=offset)
        prediction = predict(study.parameters({}, one), camera, observations.channels, dropped=one.dropped)
        return float(np.sqrt(np.mean((prediction["height"] - height.value) ** 2)))

    assert min(miss(offset) for offset in np.linspace(-0.2, 0.1, 31)) < 0.5


def test_a_held_pendulum_needs_no_rod():
    path = real("pendulum/free_decay_65cm.txt")
    text = f"""
title: Pendulum
apparatus: {{light: {{mass: 41.52 g}}}}
effects: {{light_drag: free}}
trials:
  - {{file: {path.name}, release: {{kind: held, angle: 221 deg +/- 1 deg, free_length: (65 +/- 1) cm}}}}
"""
    study = load_text(text, "pendulum.yaml", Path(path).parent)
    assert [u.name for u in study.free_parameters()] == [
        "light_drag",
        "free_decay_65cm.release_angle",
        "free_decay_65cm.free_length",
    ]
    trial = study.trials[0]
    observations = read_files(study.folder, trial)
    assert set(study.camera_priors(trial, observations)) == {"clock_offset", "clock_ratio", "tilt"}
    prediction = predict(study.parameters({}, trial), Camera(), observations.channels)
    assert np.all(np.isfinite(prediction["angle"]))
    # The first swing, before drag counts: the same period and side.
    first = observations.channel("angle").t < 1.2
    assert np.corrcoef(prediction["angle"][first], observations.channel("angle").value[first])[0, 1] > 0.98


@pytest.mark.parametrize(
    ("rows", "header", "is_seen"),
    [
        ([(i, math.sin(i), i * i) for i in range(20)], "frame,light_x,light_y", True),
        ([(i, math.sin(i), i * i) for i in range(6, 20)], "frame,light_x,light_y", True),
        ([(i, 10 * round(math.sin(i), 6), 10 * i * i) for i in range(20)], "frame,light_x [mm],light_y [mm]", True),
        ([(i, math.sin(i + 0.01), i * i) for i in range(20)], "frame,light_x,light_y", False),
    ],
    ids=["all", "a part", "in another unit", "others"],
)
def test_points_of_a_training_trial_do_not_judge_it(tmp_path, rows, header, is_seen):
    observed = []
    known = [(i, math.sin(i), i * i) for i in range(20)]
    for name, lines, names in (("first", known, "frame,light_x,light_y"), ("test", rows, header)):
        path = tmp_path / f"{name}.csv"
        path.write_text(names + "\n" + "".join(",".join(f"{c:.6f}" for c in row) + "\n" for row in lines))
        trial = Trial(name=name, files=((path.name, {}),), units={"length": "cm"}, frame_rate=200.0, held_out=name == "test")
        observed.append((trial, read_files(tmp_path, trial)))
    if is_seen:
        with pytest.raises(
            DataError, match=r"test.csv: found the points of 'first' in 'test' again, needed points that no fit"
        ):
            refuse_seen_points(observed)
    else:
        refuse_seen_points(observed)

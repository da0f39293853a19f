"""What a camera measures of a run is compared with the reference, the noise law with noise that was added."""

import math

import numpy as np
import pytest

from looping_pendulum.measured import measurement
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.measurement import predict
from looping_pendulum.measured.noise import CLIP_SIGMAS, ORDER, estimate_noise, speed_at
from looping_pendulum.measured.observations import Channel, DataError
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import solve
from tests.apparatus import TEN_TO_ONE, WITHOUT_LOSSES

FRAME = 1 / 240
CAMERA_WITH_ERRORS = Camera(
    origin_x=0.01, origin_y=-0.02, scale=1.03, tilt=0.05, foreshortening=0.96, perspective_x=0.08, perspective_y=-0.03,
    distortion=-0.1, centre_x=0.1, centre_y=-0.2, clock_offset=0.004, clock_ratio=0.98,
)  # fmt: skip


def channels(t, position, names=("light_x", "light_y")):
    return [Channel(name=name, t=t, value=value) for name, value in zip(names, position.T, strict=True)]


@pytest.fixture(autouse=True)
def _as_exact_as_solve(monkeypatch):
    monkeypatch.setattr(measurement, "FIT_TOLERANCE", 1e-12)


@pytest.fixture(scope="module")
def run():
    return solve(TEN_TO_ONE, duration=3.0)


def test_a_perfect_camera_measures_the_run(run):
    t = np.arange(0, 1.0, FRAME)
    reference = run.sample(t)
    light, heavy = (
        channels(t, 0 * reference.light_position),
        channels(t[::2], 0 * reference.heavy_position[::2], ("heavy_x", "heavy_y")),
    )
    prediction = predict(TEN_TO_ONE, Camera(), [*light, *heavy])
    # Two integrations to 1e-12 of the same run.
    assert prediction["light_x"] == pytest.approx(reference.light_position[:, 0], abs=1e-9)
    assert prediction["light_y"] == pytest.approx(reference.light_position[:, 1], abs=1e-9)
    assert prediction["heavy_y"] == pytest.approx(reference.heavy_position[::2, 1], abs=1e-9)


def test_a_camera_with_all_errors_measures_the_transformed_positions_at_the_true_times(run):
    t = np.arange(0, 1.0, FRAME)
    prediction = predict(TEN_TO_ONE, CAMERA_WITH_ERRORS, channels(t, np.zeros((len(t), 2))))
    reference = run.sample(0.004 + 0.98 * t).light_position
    assert np.stack([prediction["light_x"], prediction["light_y"]], axis=1) == pytest.approx(
        CAMERA_WITH_ERRORS.project(reference), abs=1e-9
    )


def test_before_the_release_and_after_the_end(run):
    t = np.arange(0, 1.5, FRAME)
    camera = Camera(clock_offset=-0.1)
    prediction = predict(TEN_TO_ONE, camera, channels(t, np.zeros((len(t), 2))))
    early, late = t < 0.1, t - 0.1 > run.end_time
    at_release = run.sample(np.zeros(1)).light_position[0]
    assert prediction["light_x"][early] == pytest.approx(at_release[0], abs=1e-15)
    at_end = np.array([run.sample(np.array([run.end_time])).light_position[0, axis] for axis in (0, 1)])
    assert prediction["light_x"][late] == pytest.approx(at_end[0], abs=1e-12)
    assert prediction["light_y"][late] == pytest.approx(at_end[1], abs=1e-12)
    between = ~(early | late)
    assert prediction["light_x"][between] == pytest.approx(run.sample(t[between] - 0.1).light_position[:, 0], abs=1e-9)


def test_a_held_pendulum_is_seen_as_an_angle():
    angle = 0.02
    held = TEN_TO_ONE.replace(release=Release.HELD, release_angle=math.pi + angle, rod_radius=1e-6, **WITHOUT_LOSSES)
    t = np.arange(0, 2.0, 0.05)
    pair = [Channel(name=name, t=t, value=np.zeros_like(t)) for name in ("angle", "angle_rate")]
    prediction = predict(held, Camera(tilt=0.01), pair)
    frequency = math.sqrt(9.81 / 0.58)
    # The small-angle solution; its next term changes the phase by angle^2 / 16 of w t.
    bound = angle * (angle**2 / 16 * frequency * t + 1e-4)
    assert np.all(np.abs(prediction["angle"] - 0.01 - angle * np.cos(frequency * t)) <= bound)
    assert np.all(np.abs(prediction["angle_rate"] + angle * frequency * np.sin(frequency * t)) <= frequency * bound)


@pytest.mark.parametrize("mass", ["light", "heavy"])
def test_a_drop_is_seen_as_a_height(mass):
    falling = TEN_TO_ONE.replace(release=Release.DROP, **WITHOUT_LOSSES)
    t = np.arange(0, 3.0, 1 / 15)
    prediction = predict(
        falling, Camera(origin_y=47.0, clock_offset=-0.1), [Channel(name="height", t=t, value=t)], dropped=mass
    )
    assert prediction["height"] == pytest.approx(47.0 - 0.5 * 9.81 * np.maximum(t - 0.1, 0) ** 2, abs=1e-9)


# --- noise -----------------------------------------------------------------------------------------------------------------


def spiral(count=280):
    """An analytic motion like the light mass's: it winds in from 0.5 m to 4 cm while it turns ever faster."""
    t = np.arange(count) * FRAME
    length, angle = 0.04 + 0.5 * (1 - t / 1.2) ** 2, 12 * t + 14 * t**3
    position = np.stack([-length * np.sin(angle), length * np.cos(angle)], axis=1)
    rate, angular_speed = -(1 - t / 1.2) / 1.2, 12 + 42 * t**2
    return t, position, np.hypot(rate, length * angular_speed)


def overlap_variance_factor(order):
    """Return the variance of a mean square of overlapping differences in units of that of independent ones."""
    whole = math.comb(2 * order, order)
    return 1 + 2 * sum((math.comb(2 * order, order + j) / whole) ** 2 for j in range(1, order + 1))


def law_errors(estimate, points):
    """Return the covariance of a and b, shape (2, 2), as the theory of M-estimators has it for Gaussian noise.

    Windows of neighbouring differences overlap, so that fewer differences are independent than there are.
    """
    middles = [np.lib.stride_tricks.sliding_window_view(c.t, ORDER + 1).mean(axis=1) for c in points]
    speed = np.concatenate([speed_at(points, t, estimate.a) for t in middles])
    tail = math.erfc(CLIP_SIGMAS / math.sqrt(2))
    density = math.exp(-(CLIP_SIGMAS**2) / 2) / math.sqrt(2 * math.pi)
    second = 1 - tail - 2 * CLIP_SIGMAS * density
    mean = second + CLIP_SIGMAS**2 * tail
    mean_square = 3 * second - 2 * CLIP_SIGMAS**3 * density + CLIP_SIGMAS**4 * tail
    factor = (mean_square - mean**2) / (2 * second) ** 2 * overlap_variance_factor(ORDER)
    design = np.stack([np.ones_like(speed), speed], axis=1) / (estimate.a + estimate.b * speed)[:, None]
    return factor * np.linalg.inv(design.T @ design)


LAWS = [(1e-3, 0.0), (1e-3, 5e-4), (3e-4, 3e-4), (2e-3, 1e-3)]


@pytest.mark.parametrize(("a", "b"), LAWS)
def test_the_noise_law_is_recovered_within_its_error(a, b):
    t, position, speed = spiral()
    pulls, mean_speed = [], float(speed.mean())
    for seed in range(40):
        noisy = channels(t, position + np.random.default_rng(seed).normal(size=position.shape) * (a + b * speed)[:, None])
        estimate = estimate_noise(noisy)
        covariance = law_errors(estimate, noisy)
        error = math.sqrt(np.array([1, mean_speed]) @ covariance @ np.array([1, mean_speed]))
        pulls.append((estimate.a + estimate.b * mean_speed - a - b * mean_speed) / error)
        # 40 seeds, 4 laws: one in 16 000 beyond 4 sigma
        assert abs(estimate.a - a) < 4 * math.sqrt(covariance[0, 0])
        assert abs(estimate.b - b) < 4 * math.sqrt(covariance[1, 1])
    # Mean and spread of 40 unit normal pulls: 3.5 times their own errors, 1/sqrt(40) and 1/sqrt(80).
    assert abs(np.mean(pulls)) < 3.5 / math.sqrt(40)
    assert abs(np.std(pulls) - 1) < 3.5 / math.sqrt(80)


def test_gaps_and_outliers_do_no_harm():
    t, position, speed = spiral()
    rng = np.random.default_rng(7)
    points = position + rng.normal(size=position.shape) * (1e-3 + 5e-4 * speed)[:, None]
    points[rng.choice(len(t), 3, replace=False)] += 0.2
    kept = rng.random(len(t)) > 0.1
    estimate = estimate_noise(channels(t[kept], points[kept]))
    mean_speed = speed.mean()
    # Three outliers spoil fifteen windows of two hundred: the clipped score moves by 8 % for each 5 % of them.
    assert estimate.sigma(mean_speed) == pytest.approx(1e-3 + 5e-4 * mean_speed, rel=0.25)


def test_noise_of_a_body_at_rest_does_not_depend_on_speed():
    t = np.arange(300) * FRAME
    points = np.random.default_rng(5).normal(size=(300, 2)) * 1e-3
    estimate = estimate_noise(channels(t, points))
    covariance = law_errors(estimate, channels(t, points))
    assert estimate.b < 4 * math.sqrt(covariance[1, 1])
    assert abs(estimate.a - 1e-3) < 4 * math.sqrt(covariance[0, 0])
    with pytest.raises(DataError, match="light_x: found 1 runs of 5 points, needed 20"):
        estimate_noise([Channel(name="light_x", t=t[:5], value=points[:5, 0])])


def test_data_without_noise_have_none():
    t, position, _ = spiral()
    estimate = estimate_noise(channels(t, position))
    assert estimate.a + estimate.b * 3.0 < 1e-4  # the motion's own fourth differences where it is fastest


def test_speed_follows_from_neighbouring_points():
    t, position, speed = spiral()
    sigma = 1e-3
    points = position + np.random.default_rng(2).normal(size=position.shape) * sigma
    estimate = speed_at(channels(t, points), t[5:-5], sigma)
    # Seven points give a slope to sigma / (h sqrt 28); their line flattens a circle by 7/6 (h omega)^2 of its speed.
    error = sigma / (FRAME * math.sqrt(28))
    angular_speed = 12 + 42 * t[5:-5] ** 2
    assert np.all(np.abs(estimate - speed[5:-5]) < 4 * error + 7 / 6 * (FRAME * angular_speed) ** 2 * speed[5:-5])

"""How the camera looks, fitted to all marks of the taut string together; when and at which angle the mass was let go.

With the light mass at the distance d from the rod's axis, the string that is free is sqrt(d^2 - R^2), it leaves the rod at the
bearing phi, and what the heavy mass drops is taken from it, so that

    sqrt(d^2 - R^2) + R phi + drop = L + R phi_0

in every picture, with the free length L and the bearing phi_0 at the release. The camera's part of it is that of
`measured.camera`. Every value that somebody stated, or that a careful set-up leaves small, has a prior of that error; by
Student's law, so that a value that is wrong gives way alone. The string's length after the ball has wound up, or was caught, is
no taut string's: the fit begins with the first turn and goes on turn by turn while the marks agree.

A hand may cover the light mass for a tenth of a second after the release, and a film shows when the ball is seen, not when it
was let go. From rest, though, the motion tells: `fit_release` fits the exact model, with wide priors of all that a film does
not know, to the first quarter of a second, and the model is used for nothing else.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import approx_fprime, least_squares

from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.film.pendulum import Fall, LightMass
from looping_pendulum.measured.film.record import (
    CAMERA_PRIORS,
    FITTED,
    LEAST_SCATTER,
    Geometry,
    Points,
    Release,
    Stated,
    in_the_plane,
)
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, string_from_rod
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve_at

READOUT, READOUT_PRIOR, KNOWN_READOUT_ERROR = 3e-3, 4e-3, 5e-5
"""Delay of the rows per length, its error where the time of the readout is not known, and that where it is stated [s/m].

A phone reads its picture, which shows about 1.5 m, in 3 to 16 ms: without room for it, a delay of 3.5 ms looked like a force.
"""
ROD_PRIOR, LENGTH_PRIOR = 0.02, 5e-3
"""Relative errors of rod and free length where none is stated."""
PLACE_PRIOR, SCALE_PRIOR, TILT_PRIOR = 100.0, 0.3, 0.1
"""Errors of the rod's place [pixels], of the scale, relative, and of the tilt [rad] before the fit."""
SHOWN_ERROR = 1.4
"""Error of a length between two places that a person has shown [pixels]; of one place, it is less by the root of 2."""
TIE_ERROR, SWING_ERROR = 5e-4, 0.15
"""Distance of the heavy mass's vertical from the rod's edge [m], and its error by a swing [pixels of a picture 1280 wide]."""
FREEDOM = 3.0
"""Degrees of freedom of Student's t, by which a stated value is wrong in units of its error; as in `evidence.prior`."""
SHARED_SECONDS, LEAST_SHARED = 0.04, 4.0
"""Time over which neighbouring marks share their errors by shading and background [s], and the fewest marks that do."""
TURN = 2 * math.pi
AGREES, LEAST_DEPARTURE, FEW = 5.0, 0.5, 7
"""Departure from the taut string, in its errors, up to which a mark agrees with it, the least scatter by which that is judged
[pixels], and the marks in a row of which most must agree."""
MAX_ITERATIONS, STEP, CONVERGED = 25, 1e-4, 1e-2
"""Of a fit: the most steps, the step of differences, and the largest change of a converged one [prior errors]."""
BEFORE, AFTER = 0.25, 0.22
"""Time before and after the first motion whose marks are used [s]; later, friction and drag count."""
LIGHT_MASS = 0.01
"""Mass of the light mass in the fit, where only ratios count [kg]."""
RATIO, FRICTION, DRAG = (7.0, 0.8), (0.3, 0.2), (5e-4, 1e-3)
"""Heavy mass over light mass, friction, and all drags in proportion to the square of a speed [kg/m], each with its prior
standard deviation; that of the ratio is its logarithm's."""
SIDE_PRIOR, PUSH_PRIOR = 0.03, 0.02
"""Of a steady force across the string, as of a draught, over the light mass's weight, and of the speed of letting go [m/s]."""
REST_ERROR, HELD_ERROR = 0.12, 0.7
"""Error that all pictures of the resting heavy mass share, as codecs repeat them, and all of the held light mass, of which a
finger may cover a part [pixels]."""
ANGLES = (0.1, 3.9)
"""Angles of a string from which a light mass is let go [rad]."""
LEAST_LEFT = 0.1
"""Least mean square that may be left of the light mass's marks, in their errors."""
FIRST_MOTION_ERROR = 1.5e-4
"""Error of the instant by what a codec and a flickering lamp do to the first hundredths of a millimetre [s]."""
LEAST_MARKS = 6
"""Fewest marks of each mass after the release."""
FIT_TOLERANCE = 1e-9
MAX_ANGLE_ERROR = math.radians(5.0)
"""Error above which the film is said not to show the angle [rad]."""


class _Misfit:
    """What departs from a taut string, by values z of `FITTED`, in units of their prior errors from their priors."""

    def __init__(
        self, light: LightMass, fall: Fall, t: Array, side: int, size: tuple[int, int],
        known: Mapping[str, Stated], bearing: float,
    ) -> None:  # fmt: skip
        self.side, self.size, self.bearing = side, size, bearing
        shown = fall.known[light.frames]
        self.frames = light.frames[shown]
        self.turns = light.phi[shown]
        self.light = light.points[shown]
        # The last row is that of the release, the one before it the lowest
        low = np.append(fall.heights[self.frames], [float(fall.rows[:, 2].max()), fall.heights[fall.first]])
        self.heavy = np.stack([fall.column(low), low], axis=-1)
        self.falling = np.gradient(fall.heights, t)[self.frames]
        """Speed of the heavy mass [pixels/s]."""
        # The heavy mass swings a little, and its points scatter, by which its vertical has an error
        x, y = fall.rows[:, 1] - fall.column(fall.rows[:, 2]), fall.rows[:, 2]
        scatter = max(1.4826 * float(np.median(np.abs(x - np.median(x)))), 0.1)
        of_points = scatter * 3 / math.sqrt(len(y)) / max(float(np.std(y)), 1.0)
        of_swing = SWING_ERROR * max(size) / 1280 / float(np.ptp(y))
        self.tie_errors = np.array([TIE_ERROR, np.hypot(of_points, of_swing)])
        self.shared = max(SHARED_SECONDS / float(np.median(np.diff(t))), LEAST_SHARED)
        self.centre = np.array([known[n].value for n in FITTED])
        self.error = np.array([known[n].error for n in FITTED])

    def values(self, z: Array) -> dict[str, float]:
        return dict(zip(FITTED, (self.centre + self.error * z).tolist(), strict=True))

    def at(self, z: Array, chosen: NDArray[np.bool_]) -> Array:
        """Return how much longer the string is than the taut one in some frames [pixels], then two ties of the heavy mass.

        It hangs from the rod's edge, and falls straight down: both in units of their errors.
        """
        v = self.values(z)
        radius, scale = v["rod_radius"], v["scale"]
        places = np.concatenate([self.light[chosen], self.heavy[np.append(chosen, (True, True))]])
        position = in_the_plane(places, v, self.side, self.size)
        n = int(chosen.sum())
        light, heavy, (lowest, rest) = position[:n], position[n:-2], position[-2:]
        free, phi = string_from_rod(light[:, 0], light[:, 1], radius)
        phi += TURN * np.round((self.turns[chosen] - phi) / TURN)
        # The row of the light mass is read at another time than that of the heavy one
        drop = rest[1] - heavy[:, 1] + self.falling[chosen] / scale * v["readout"] * (heavy[:, 1] - light[:, 1])
        taut = v["free_length"] + radius * self.bearing
        lean = (lowest[0] - rest[0]) / (lowest[1] - rest[1])
        return np.append(scale * (free + radius * phi + drop - taut), np.array([rest[0] - radius, lean]) / self.tie_errors)

    def jacobian(self, z: Array, chosen: NDArray[np.bool_]) -> Array:
        """Return the derivatives of `at` by z."""
        return np.asarray(approx_fprime(z, self.at, STEP, chosen))

    def solved(self, z: Array, chosen: NDArray[np.bool_], scatter: float) -> tuple[Array, Array, Array, float]:
        """Return the fit to some marks of a scatter [pixels], by reweighted least squares, and its covariance [prior errors];
        then how much longer the string is than the taut one in their frames, and how that scatters [pixels].
        """
        for _ in range(MAX_ITERATIONS):
            off = self.at(z, chosen)
            derivative = self.jacobian(z, chosen)
            weight = 1 / np.sqrt(1 + (off / scatter) ** 2) / (self.shared * scatter**2)
            weight[-2:] = 1.0
            of_prior = (FREEDOM + 1) / (FREEDOM + z**2)
            normal = derivative.T @ (weight[:, None] * derivative) + np.diag(of_prior)
            step = np.linalg.solve(normal, -(derivative.T @ (weight * off) + of_prior * z))
            z = z + np.clip(step, -2, 2)
            if np.abs(step).max() < CONVERGED:
                break
        residual = self.at(z, chosen)[:-2]
        scatter = max(1.4826 * float(np.median(np.abs(residual))), LEAST_SCATTER)
        return z, np.asarray(np.linalg.inv(normal), dtype=np.float64), residual, scatter


def fit_camera(
    light: LightMass, fall: Fall, t: Array, *, side: int, size: tuple[int, int],
    start: Mapping[str, float], priors: Mapping[str, Stated], bearing: float,
) -> Geometry:  # fmt: skip
    """Fit everything to the marks of the taut string.

    Parameters
    ----------
    t
        Time of each frame [s].
    start
        Name, of `FITTED`, -> value with which the fit begins; the others begin with their priors.
    priors
        Name -> what is known of it: `rod_radius` and `free_length` at least.
    bearing
        Bearing of the string at the release, in the first turn [rad]; that of the light mass counts turns from there.
    """
    known = {name: Stated(value=float(name == "foreshortening"), error=e) for name, e in CAMERA_PRIORS.items()}
    known["readout"] = Stated(value=READOUT, error=READOUT_PRIOR)
    known |= {name: Stated(value=start[name], error=PLACE_PRIOR) for name in ("rod_x", "rod_y")}
    known["tilt"] = Stated(value=math.atan(fall.slope), error=TILT_PRIOR)
    known["scale"] = Stated(value=start["scale"], error=SCALE_PRIOR * start["scale"])
    known |= dict(priors)
    misfit = _Misfit(light, fall, t, side, size, known, bearing)
    z = np.array([(start.get(n, known[n].value) - known[n].value) / known[n].error for n in FITTED])
    scatter = 2.0
    turned = misfit.turns - misfit.turns[0]
    reach = 0.5 * TURN
    taut = np.ones(len(turned), dtype=bool)
    while True:
        chosen = taut & (turned <= reach)
        z, covariance, _, scatter = misfit.solved(z, chosen, scatter)
        following = np.flatnonzero(taut & (turned > reach) & (turned <= reach + TURN))
        if len(following):
            ahead = np.isin(np.arange(len(turned)), following)
            off = misfit.at(z, ahead)
            derivative = misfit.jacobian(z, ahead)[:-2]
            expected = np.einsum("ij,jk,ik->i", derivative, covariance, derivative)
            slack = np.abs(off[:-2]) > AGREES * np.sqrt(expected + max(scatter, LEAST_DEPARTURE) ** 2)
            # Where most of the next few marks are off, the taut string has ended: the ball is wound up, or caught
            few = np.convolve(np.append(slack, np.ones(FEW - 1)), np.ones(FEW) / FEW, "valid")
            ends = np.flatnonzero(slack & (few > 0.5))
            if len(ends):
                taut &= np.arange(len(turned)) < following[ends[0]]
        if not (taut & (turned > reach)).any():
            break
        reach += TURN
    for _ in range(3):
        before = scatter
        z, covariance, residual, scatter = misfit.solved(z, taut, before)
        if abs(scatter / before - 1) < 0.02:
            break
    deviation = misfit.error * np.sqrt(np.diag(covariance))
    return Geometry(
        side=side, size=size, bearing=bearing, values=misfit.values(z),
        errors=dict(zip(FITTED, deviation.tolist(), strict=True)), priors=known, frames=misfit.frames[taut], residual=residual,
    )  # fmt: skip


def fit_release(
    geometry: Geometry, t: Array, light: Points, heavy: Points, moves: int, angle: float, hanging_length: float
) -> Release | None:
    """Fit the release; None: the film does not show it.

    Parameters
    ----------
    t
        Time of each frame [s].
    moves
        A frame in which the heavy mass has just begun to move.
    angle
        Angle with which the fit begins [rad].
    hanging_length
        String from the rod's height to the heavy mass at the release [m].
    """
    begin = float(t[moves])
    early_light, early_heavy = (
        (t[points.frame] > begin - BEFORE) & (t[points.frame] < begin + AFTER) for points in (light, heavy)
    )
    if min(np.sum(early_light & (t[light.frame] > begin)), np.sum(early_heavy & (t[heavy.frame] > begin))) < LEAST_MARKS:
        return None
    place, low = geometry.metres(light.place[early_light]), geometry.metres(heavy.place[early_heavy])[:, 1]
    scale = geometry.scale
    t_light, t_heavy = t[light.frame[early_light]], t[heavy.frame[early_heavy]]
    is_held = t_light < begin - 0.02
    sigma_light = light.counted_error[early_light]
    sigma_light = np.hypot(sigma_light, np.where(is_held, HELD_ERROR * math.sqrt(max(is_held.sum(), 1)), 0.0)[:, None]) / scale
    sigma_heavy = heavy.counted_error[early_heavy, 1] / scale
    rest = float(np.median(low[t_heavy < begin])) if np.any(t_heavy < begin) else float(low[0])
    # What the marks tell is the string's whole length, of which more lies on the rod at a larger angle
    radius = geometry.rod_radius
    taut = geometry.values["free_length"] + radius * geometry.bearing

    def residuals(p: Array) -> Array:
        start, angle, ratio, friction, drag, side, push, readout, height, beside = p
        drag = max(DRAG[0] + DRAG[1] * drag, 0.0)
        parameters = Parameters(
            light_mass=LIGHT_MASS,
            heavy_mass=LIGHT_MASS * RATIO[0] * math.exp(RATIO[1] * ratio),
            rod_radius=radius,
            free_length=taut - radius * angle,
            release_angle=angle,
            hanging_length=hanging_length,
            coefficients={
                "kinetic_friction": max(FRICTION[0] + FRICTION[1] * friction, 0.0),
                "light_drag": drag,
                "heavy_drag": drag,
                "string_drag": drag,
                "side_force": SIDE_PRIOR * side * LIGHT_MASS * GRAVITY.coefficients[0].default,
                "push_across": PUSH_PRIOR * push,
            },
        )
        # A row below the rod's is read later
        delay = geometry.values["readout"] + geometry.errors["readout"] * readout
        since = [np.maximum(now - delay * y - start, 0.0) for now, y in ((t_light, place[:, 1]), (t_heavy, low))]
        times, index = np.unique(np.concatenate(since), return_inverse=True)
        run = solve_at(parameters, times, duration=float(times[-1]) + 1e-3, tolerance=FIT_TOLERANCE)
        at = np.minimum(index, len(run.t) - 1)
        expected, drop = run.light_position[at[: len(t_light)]], run.heavy_position[at[len(t_light) :], 1] + hanging_length
        moved = np.where(t_heavy < start, REST_ERROR / scale * beside, 0.0)
        marks = np.concatenate(
            [((place - expected) / sigma_light).ravel(), (low - rest - height / scale - drop - moved) / sigma_heavy]
        )
        # Of marks far off, as of a finger, only the logarithm counts, and so it does of a hand that pushes. The height of rest
        # is not known before
        robust = np.append(marks, [side, push])
        robust = np.sign(robust) * np.sqrt(9 * np.log1p(robust**2 / 9))
        return np.concatenate([robust, [ratio, friction, p[4], readout, beside, 1e-3 * height]])

    least = np.array([begin - 0.2, ANGLES[0], -3, -FRICTION[0] / FRICTION[1], -DRAG[0] / DRAG[1], -5, -5, -5, -50, -5])
    most = np.array([begin + 0.05, ANGLES[1], 3, 5, 5, 5, 5, 5, 50, 5])
    unit = np.array([0.01, 0.05, *(1.0,) * 8])
    best = None
    # Half a radian off, one in four fits ends in another minimum, as gravity turns the string alike above and below level
    for first_angle in (np.clip(angle, *ANGLES), 0.5 * math.pi):
        guess = np.array([begin - 0.01, first_angle, *np.zeros(8)])
        with contextlib.suppress(HarnessError):
            found = least_squares(
                residuals, guess, bounds=(least - 1e-6, most + 1e-6), x_scale=unit, ftol=1e-4, xtol=1e-5,
                jac=lambda p: approx_fprime(p, residuals, STEP * unit),
            )  # fmt: skip
            if best is None or found.cost < best.cost - 1:  # less is where in the same minimum a fit stops
                best = found
    if best is None:
        return None
    normal = best.jac.T @ best.jac
    of_light, of_heavy = (float(np.mean(part**2)) for part in np.split(best.fun[: 2 * len(place) + len(low)], [2 * len(place)]))
    time_error = math.hypot(math.sqrt(np.linalg.inv(normal)[0, 0] * max(of_heavy, 1.0)), FIRST_MOTION_ERROR)
    # The angle is the moving light mass's, whose marks are better than their errors, which hold for one that rests, too
    at_best = np.where(np.arange(len(best.fun)) < 2 * len(place), max(of_light, LEAST_LEFT), max(of_heavy, 1.0))
    angle_variance = np.linalg.inv(best.jac.T @ (best.jac / at_best[:, None]))[1, 1]
    turned = math.hypot(
        geometry.errors["tilt"], math.hypot(geometry.errors["rod_x"], geometry.errors["rod_y"]) / (scale * taut)
    )
    angle_error = math.hypot(math.sqrt(angle_variance), turned)
    return Release(
        time=float(best.x[0]),
        time_error=time_error,
        angle=float(best.x[1]),
        angle_error=angle_error if angle_error < MAX_ANGLE_ERROR else None,
    )

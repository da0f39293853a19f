"""What is said of a tracked film: what was found in it, what contradicts it, and the lines of a study."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.measured.film.decode import CLOCK_SOURCE
from looping_pendulum.measured.film.geometry import KNOWN_READOUT_ERROR
from looping_pendulum.measured.film.record import FilmFacts, FilmTrack
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array, string_coordinates

MAX_GRAVITY_RATIO = 1.2
"""Ratio of gravity in a film to the true one from which on clock or scale are in doubt: drag and draughts change it by less."""
GRAVITY_EFFECTS = 0.06
"""Standard error of gravity in a film, relative, by drag and draughts: in rendered films they change it by up to this."""
CAMERA_RATES = (24, 25, 30, 50, 60, 100, 120, 200, 240, 300, 480, 960)
"""Frame rates that cameras have [Hz]."""
LEAST_SLOWING = 1.4
"""Least factor by which a film's clock departs from the true one: slow motion is slower by far, never by a fifth."""
STRAIGHT_STRING = 0.75
"""Scatter of the string's length up to which nothing bends it [pixels of a picture 1280 wide]."""
FIRST_MOTION, LEAST_FIRST_POINTS = 0.3, 6
"""Part of the motion whose acceleration shows gravity [s], and fewest points of it."""
TRUE_GRAVITY = GRAVITY.coefficients[0].default
"""[m/s^2]"""


def sentence(track: FilmTrack) -> str:
    """Say in one line what was found."""
    view = track.geometry
    return (
        f"{track.path}: light mass in {track.share:.0%} of the frames after the release, "
        f"{view.scatter:.2f} pixels from a taut string; "
        f"scale {view.scale:.1f} pixels per metre +/- {view.scale_error:.2%} by {track.scale_source}; released at "
        f"{track.release.time:.3f} s; {track.facts.clock.rate:.4g} frames per second, {track.facts.clock.rate_source}"
        + ("; mirrored, as the light mass starts on the right" if view.side < 0 else "")
    )


def contradictions(track: FilmTrack) -> list[str]:
    """Say which stated values the film contradicts, and what it shows."""
    view, found = track.geometry, []
    if view.is_bent:
        found.append(
            f"found the string's length {view.scatter:.1f} pixels from a taut one, though neighbouring marks scatter by "
            f"{view.noise:.1f}, needed the same; is the string slack or elastic, the picture bent? See the sheet"
        )
    rod, length = (view.values[name] for name in ("rod_radius", "free_length"))
    for name in view.contradicted():
        stated, error = view.priors[name].value, view.errors[name]
        digits = max(0, 1 - math.floor(math.log10(1e3 * error)))
        what, other = ("rod of radius", "free length") if name == "rod_radius" else ("free length of", "rod")
        # Of both, the film shows the ratio
        instead = length * stated / rod if name == "rod_radius" else rod * stated / length
        found.append(
            f"the film shows a {what} {1e3 * view.values[name]:.{digits}f} +/- {1e3 * error:.{digits}f} mm, stated "
            f"{1e3 * stated:.{digits}f} mm, or a {other} of {1e3 * instead:.4g} mm beside that; measure both again"
        )
    return found


def doubt(track: FilmTrack) -> str:
    """Say that clock or scale contradict gravity, if they do by more than any effect on the first motion; else nothing."""
    gravity, error = gravity_shown(track)
    if not abs(math.log(max(gravity, 1e-3) / TRUE_GRAVITY)) > math.log(MAX_GRAVITY_RATIO):
        return ""
    length = "the shown length" if track.settings.scale is not None else "the free length"
    found = f"found gravity of {gravity:.3g} +/- {error:.2g} m/s^2 by the light mass's first motion, "
    found += f"needed {TRUE_GRAVITY:g} m/s^2; "
    if rate := _explaining_rate(track, gravity / TRUE_GRAVITY, error / abs(gravity)):
        return found + f'either the true frame rate is {rate:.6g} Hz (--frame-rate "{rate:.6g} Hz"), or {length} is wrong'
    return (
        found
        + f"no frame rate of a camera explains it: check {length}, whether a circle is one in the picture, and whether the "
        "film keeps its speed"
    )


def _explaining_rate(track: FilmTrack, ratio: float, error: float) -> float | None:
    """Return the frame rate [Hz] of a camera by which gravity would be the true one; None where there is none.

    A rate would only hide what bends the string: a camera from the side, pixels that are not square, a wrong rod.

    Parameters
    ----------
    ratio
        Gravity in the film over the true one.
    error
        Its relative error, without that of drag and draughts.
    """
    if ratio <= 0 or track.geometry.scatter > STRAIGHT_STRING * track.facts.unit:
        return None
    own = track.facts.clock.rate
    # The rate goes with the root of gravity, so that its relative error is half as large: twice that is allowed
    allowed = math.hypot(error, GRAVITY_EFFECTS)
    least = LEAST_SLOWING if track.facts.clock.rate_source == CLOCK_SOURCE else 1.0
    others = (rate for rate in CAMERA_RATES if abs(math.log(rate / own)) > math.log(least))
    off, best = min((abs(math.log(rate / own * math.sqrt(ratio))), rate) for rate in others)
    return best if off < allowed else None


def gravity_shown(track: FilmTrack) -> tuple[float, float]:
    """Return the acceleration of free fall by the light mass's first motion across its string, and its error [m/s^2].

    Across the string, nothing but gravity acts, and speed along it that turns across, as `look` judges it. The error is
    that of the points, of the rod and of the scale; drag and draughts come to it.
    """
    since, window, gravity, error = track.t[track.light.frame] - track.release.time, FIRST_MOTION, math.nan, math.inf
    for _ in range(6):
        chosen = (since > 0) & (since < window)
        if np.sum(chosen) < LEAST_FIRST_POINTS:
            window *= 2  # the hand covers it for so long, if time is stretched
            continue
        gravity, error = _gravity(track, since, chosen)
        # Where clock or scale are wrong, the first motion takes another time by them
        window = FIRST_MOTION * math.sqrt(TRUE_GRAVITY / max(gravity, 0.1))
    return gravity, error


def _gravity(track: FilmTrack, since: Array, chosen: NDArray[np.bool_]) -> tuple[float, float]:
    """Return `gravity_shown` by some points, of times since the release [s]."""
    t, place, radius = since[chosen], track.geometry.metres(track.light.place)[chosen], track.geometry.rod_radius
    error = np.hypot(*track.light.error[chosen].T) / math.sqrt(2) / track.geometry.scale
    length, phi = string_coordinates(place, radius, track.release.angle)
    dt, turn = np.diff(t), np.diff(phi)
    across = 0.5 * (length[1:] + length[:-1]) * turn / dt
    turned = (np.diff(length) + radius * turn) * turn / dt
    pull = np.sin(0.5 * (phi[1:] + phi[:-1])) * dt
    middle = [np.cumsum(steps) - 0.5 * steps for steps in (turned, pull)]
    weight = middle[1] - middle[1].mean()
    weight /= weight @ weight
    gravity = float(weight @ (across + middle[0]))
    # An error of a place changes the speed before it and the one after it against each other
    of_places = np.diff(weight / dt, prepend=0.0, append=0.0) * error
    view = track.geometry
    of_rod = gravity * math.hypot(view.errors["rod_x"], view.errors["rod_y"]) / view.scale / float(np.mean(length))
    return gravity, math.hypot(float(np.linalg.norm(of_places)), of_rod, gravity * view.scale_error)


def film_notes(facts: FilmFacts) -> list[str]:
    """Return sentences on what the film's pictures are, where that is not what one expects."""
    notes = []
    if facts.pixel_aspect != 1:
        notes.append(
            f"the film states pixels {facts.pixel_aspect:.4g} times as wide as high: its pictures were made {facts.width} by "
            f"{facts.height} square ones"
        )
    if facts.interlaced:
        notes.append(
            "the pictures are interlaced, so that alternate rows show different instants and a fast mass is a comb: film "
            "progressively, or deinterlace the film first, for example by ffmpeg -i FILM -vf bwdif NEW.mp4"
        )
    return notes


def study_lines(track: FilmTrack, file: str) -> str:
    """Return the lines of a study for this film's trial, to copy; the errors of its camera go with the points."""
    shown, settings = track.shown(), track.settings
    length = ""
    if settings.free_length is not None:
        error = f" +/- {1e3 * settings.free_length_error:.3g} mm" if settings.free_length_error else ""
        length = f", free_length: {100 * settings.free_length:.6g} cm{error}"
    lines = [
        f"  - file: {file}",
        f"    light: {{radius: {shown['light_radius']}}}",
        f"    release: {{kind: looping, angle: {shown.get('release_angle', 'TODO')}{length},",
        f"      hanging_length: {shown['hanging_length']}}}",
    ]
    if settings.readout is not None:
        delay = settings.readout * track.geometry.scale / track.facts.height
        lines.append(f"    camera: {{readout: {delay:.4g} s/m +/- {KNOWN_READOUT_ERROR:.2g} s/m}}")
    return "\n".join(lines)

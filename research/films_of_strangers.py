"""Studies and single films as strangers make them: every property is drawn, and every stated value has its error.

`python -m research.films_of_strangers --seeds 900-939 --folder F` renders studies of three films, types docs/film.md's
commands for each, every command in its own process, and prints a line for each study and a summary. `--releases 40` tracks
single films, and prints errors of the release's instant and angle over their stated errors.

The release is compared at the rod's row: a frame's time is when that row is read. Upright phones have no rolling readout here:
they would read columns of the upright picture, and the renderer reads rows.
"""

import argparse
import hashlib
import json
import math
import os
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from tests.blind import Effects
from tests.measured.film.renderer import Scene, Truth, looping_motion, render, seen_by_a_camera, until_ball_rests
from tests.measured.film.test_rendered_studies import OF_A_CAMERA

ROOT = Path(__file__).parents[1]
STRING_LENGTH = 0.64
"""[m]"""
HIDDEN = {
    "side_force": Effects(side_force=5e-3),
    "light_linear_drag": Effects(linear_drag=2e-3),
    "friction_per_wrap": Effects(friction_per_wrap=0.06),
    "push_across": Effects(push=0.06),
    "string_mass": Effects(string_density=1e-3 / STRING_LENGTH),
    "wrong_rod_radius": Effects(),
}
"""Name of an effect in the library -> what nobody declared."""
OTHER_NAMES = {"string_density": "string_mass"}
TRIALS = ((0.1, 114.0), (0.06, 105.0), (0.12, 98.0))
"""Heavy mass [kg] and angle of the release [deg] of each film, about which they are drawn."""
ROD_RADIUS = 6.25e-3
"""[m]"""
THICKER = 1.05
"""True over stated radius where `wrong_rod_radius` is hidden."""
LENGTH_ERROR = 1e-3
"""Standard error of the stated free length [m]."""
MASS_ERROR = 5e-3
"""Of each stated mass, relative."""
EDGE = 60
"""Least distance of a mass from the picture's edge [px]."""
ANGLE_ERROR = 0.0052
"""Of a film's own angle, if the track has none [rad]."""
COMMAND_SECONDS = 1500


@dataclass(frozen=True, kw_only=True)
class Case:
    """The apparatus, its camera, and what somebody writes down who measured it."""

    seed: int
    hidden: str | None = None
    """Key of `HIDDEN`."""
    apparatus: dict[str, float]
    """Of `Apparatus`, true, but for what differs between films."""
    heavy_masses: tuple[float, ...]
    """True [kg], one for each film."""
    angles: tuple[float, ...]
    """Of the release [deg]."""
    hanging_lengths: tuple[float, ...]
    """[m]"""
    caught: tuple[float, ...]
    """When a hand catches the ball [s]; inf: it winds up to the rod."""
    stopping: float = 0.01
    """Time in which the hand stops it [s]."""
    scene: dict[str, Any]
    """Of `Scene`."""
    camera: dict[str, float]
    """Of `seen_by_a_camera`."""
    stated_light_mass: float
    """[kg]"""
    stated_heavy_masses: tuple[float, ...]
    stated_rod_radius: float
    """[m]"""
    rod_error: float = 0.01
    """Its stated error, relative."""
    stated_free_length: float
    """[m]"""

    def __str__(self) -> str:
        """Return the kind of case in words."""
        s = self.scene
        kind = [f"{s['frame_rate']:g}/s", f"1/{1 / s['exposure']:.0f} s", f"covered {1e3 * s['covered']:.0f} ms"]
        kind += [f"readout {1e3 * s['readout']:.1f} ms"] if s["readout"] else []
        kind += [name for name in ("flicker", "drift", "cloud", "clutter", "posters", "rod_side") if s.get(name)]
        kind += ["upright"] if s.get("rotation") else []
        kind += [f"pixels {s['aspect']}"] if "aspect" in s else []
        kind += [f"ball {1e3 * s['light_radius']:.1f} mm", "caught" if math.isfinite(self.caught[0]) else "wound"]
        return ", ".join(kind)


def drawn(seed: int, *, clean: bool = False) -> Case:
    """Return a study of three films whose every property is drawn; of ten in a row, each of `HIDDEN` is in one.

    Parameters
    ----------
    clean
        Whether nothing is hidden in any.
    """
    random = np.random.default_rng(seed)
    kinds = [*HIDDEN, *[None] * 4]
    hidden = None if clean else kinds[np.random.default_rng(seed // 10).permutation(10)[seed % 10]]
    rate = float(random.choice([60, 120, 240]))
    upright = bool(random.random() < 0.2)
    scene: dict[str, Any] = {
        "frame_rate": rate,
        "exposure": _between_logs(random, 1e-3, 1 / 120 if rate == 60 else 1 / 240),
        "covered": float(random.uniform(0.02, 0.09)),
        "readout": float(random.choice([0, 1]) * random.uniform(1e-3, 8e-3)),
        "crf": int(random.integers(20, 28)),
        "noise": float(random.uniform(0.6, 1.2)),
        "light_radius": float(random.uniform(5e-3, 12e-3)),
        "rod_side": bool(random.random() < 0.7),
    }
    light = random.choice(["steady", "flicker", "drift"])
    flicker = float(random.uniform(0.03, 0.15)), float(random.choice([100, 120]))
    drift = float(random.uniform(0.1, 0.35) * random.choice([-1, 1])), float(random.uniform(-0.1, 0.3)), 0.3
    cloud = float(random.uniform(0.05, 0.25) * random.choice([-1, 1]))
    scene |= {"steady": {}, "flicker": {"flicker": flicker}, "drift": {"drift": drift, "cloud": cloud}}[str(light)]
    ground = str(random.choice(["panel", "clutter", "posters"]))
    scene |= {} if ground == "panel" else {ground: True}
    aspect = [Fraction(16, 15), Fraction(4, 3), Fraction(10, 11)][random.integers(3)]
    if random.random() < 1 / 8 and not upright:
        scene["aspect"] = aspect
    if upright:
        scene |= {"size": (720, 1280), "rotation": 90, "readout": 0.0}
    off, bearing = random.uniform(0, 0.5), random.uniform(0, 2 * math.pi)
    camera = {"aside": off * math.cos(bearing), "above": off * math.sin(bearing), "lens": float(random.uniform(-0.01, 0.01))}
    is_caught = bool(random.random() < 0.3)
    return _measured(
        random, seed, TRIALS, hidden, scene, camera,
        caught=tuple(float(v) for v in random.uniform(0.5, 0.75, 3)) if is_caught else (math.inf,) * 3,
        stopping=_between_logs(random, 5e-3, 0.08), is_exact=False,
    )  # fmt: skip


def released(seed: int) -> Case:
    """Return one film of an apparatus that is stated exactly, and whose release is drawn."""
    random = np.random.default_rng(10_000 + seed)
    rate = float(random.choice([60, 120, 240]))
    scene = {
        "frame_rate": rate,
        "exposure": _between_logs(random, 1e-3, 1 / rate),
        "covered": float(random.uniform(0, 0.1)),
        "readout": float(random.uniform(0, 12e-3)),
        "light_radius": float(random.uniform(5e-3, 12e-3)),
        "posters": bool(random.random() < 0.5),
    }
    trial = float(random.uniform(0.06, 0.12)), float(random.uniform(98, 114))
    return _measured(random, seed, (trial,), None, scene, {}, caught=(math.inf,), stopping=0.01, is_exact=True)


def _between_logs(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(math.log(low), math.log(high))))


def _measured(
    random: np.random.Generator, seed: int, trials: tuple[tuple[float, float], ...], hidden: str | None,
    scene: dict[str, Any], camera: dict[str, float], *, caught: tuple[float, ...], stopping: float, is_exact: bool,
) -> Case:  # fmt: skip
    """Return a case whose stated values are off by their errors, unless they are exact."""
    free_length = float(random.uniform(0.54, 0.6))
    masses = [heavy_mass * (1 + float(random.uniform(-0.03, 0.03))) for heavy_mass, _ in trials]
    angles = tuple(angle + float(random.uniform(-3, 3)) for _, angle in trials)
    apparatus = {"light_mass": 0.010, "rod_radius": ROD_RADIUS, "free_length": free_length}
    apparatus |= {"friction": float(random.uniform(0.28, 0.38))}
    rod, rod_error = ROD_RADIUS, 0.01
    if hidden == "wrong_rod_radius":
        apparatus["rod_radius"], rod_error = THICKER * ROD_RADIUS, 5e-3
    off = np.zeros(3 + len(masses)) if is_exact else random.standard_normal(3 + len(masses))
    return Case(
        seed=seed, hidden=hidden, apparatus=apparatus, heavy_masses=tuple(masses), angles=angles,
        hanging_lengths=tuple(float(random.uniform(0.05, 0.08)) for _ in trials),
        caught=caught, stopping=stopping, scene=scene, camera=camera,
        stated_light_mass=0.010 * (1 + MASS_ERROR * off[0]), stated_rod_radius=rod * (1 + rod_error * off[1]),
        rod_error=rod_error, stated_free_length=free_length + LENGTH_ERROR * off[2],
        stated_heavy_masses=tuple(m * (1 + MASS_ERROR * v) for m, v in zip(masses, off[3:], strict=True)),
    )  # fmt: skip


def rendered(folder: str | Path, case: Case) -> Path:
    """Return the folder of a case's films and its truth.json, which are made unless the same sources did so before."""
    folder = Path(folder)
    known = folder / "truth.json"
    sources = [ROOT / "tests" / name for name in ("measured/film/renderer.py", "blind/simulator.py")]
    made_of = repr(case) + hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    if known.exists() and json.loads(known.read_text())["made_of"] == made_of:
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(20_000 + case.seed)
    motions = []
    for mass, angle, hanging, caught in zip(case.heavy_masses, case.angles, case.hanging_lengths, case.caught, strict=True):
        motion = looping_motion(
            1.3, HIDDEN.get(case.hidden or ""), heavy_mass=mass, release_angle=math.radians(angle), hanging_length=hanging,
            **case.apparatus,
        )  # fmt: skip
        motions.append(until_ball_rests(motion, case.scene["light_radius"], caught, case.stopping))
    scene = _framed(Scene(before=0.3, preset="superfast", **case.scene), motions, random)
    films = []
    for k, motion in enumerate(motions, start=1):
        end = float(motion.t[np.any(np.abs(motion.light - motion.light[-1]) > 1e-5, axis=1)][-1])
        seed = int(random.integers(1, 2**31))
        project = seen_by_a_camera(scene, distance=2.0, **case.camera) if case.camera else None
        own = replace(scene, duration=min(end + 0.15, 1.3), seed=seed, project=project)
        truth = render(folder / f"t{k}.mp4", own, motion)
        films.append(_truth(truth, scene, case, k, end))
    tree = {
        "made_of": made_of, "seed": case.seed, "hidden": case.hidden, "kind": str(case),
        "apparatus": case.apparatus, "camera": case.camera,
        "scene": {name: str(value) for name, value in case.scene.items()}, "scale": scene.scale, "films": films,
    }  # fmt: skip
    known.write_text(json.dumps(tree, indent=1))
    return folder


def _framed(scene: Scene, motions: list[Any], random: np.random.Generator) -> Scene:
    """Return a scene in which all motions fit into the picture, at a scale of 900 px/m at most."""
    places = np.vstack([part[:, :2] * (1, -1) for m in motions for part in (m.light, m.heavy)])
    low, high = places.min(axis=0), np.maximum(places.max(axis=0), 0)
    low = np.minimum(low, 0)
    room = np.array(scene.size) - 2 * EDGE
    scale = min(float(np.min(room / (high - low))), 900.0)
    rod = EDGE - scale * low + random.uniform(0.2, 0.8, 2) * (room - scale * (high - low))
    return replace(scene, scale=scale, rod=(float(rod[0]), float(rod[1])))


def _truth(truth: Truth, scene: Scene, case: Case, k: int, end: float) -> dict[str, Any]:
    """Return what a track of the film should find: its clock begins with the first frame's reading of the rod's row."""
    late = scene.readout * (truth.rod[1] / scene.size[1] - 0.5)
    return {
        "file": f"t{k}.mp4", "angle_deg": case.angles[k - 1], "release_s": -float(truth.t[0]) - late, "end_s": end,
        "frames": len(truth.t), "rod_px": list(truth.rod), "hanging_m": case.hanging_lengths[k - 1],
        "heavy_mass_kg": case.heavy_masses[k - 1],
    }  # fmt: skip


def commands(case: Case) -> list[list[str]]:
    """Return what a user types, who reads docs/film.md and lets the film tell its release."""
    length = f"{100 * case.stated_free_length:.2f} cm +/- {1e3 * LENGTH_ERROR:g} mm"
    apparatus = ["--free-length", length, "--rod-radius", rod_radius(case)]
    films = [f"t{k}.mp4" for k in range(1, len(case.angles) + 1)]
    masses = ["--light-mass", f"{1e3 * case.stated_light_mass:.3f} g +/- {MASS_ERROR:.1%}".replace("%", " %")]
    for mass in case.stated_heavy_masses:
        masses += ["--heavy-mass", f"{1e3 * mass:.2f} g +/- {MASS_ERROR:.1%}".replace("%", " %")]
    return [
        *(["looping-pendulum", "track", film, *apparatus] for film in films),
        ["looping-pendulum", "new", "study", *films, *masses, *apparatus, "--out", "study.yaml"],
        ["looping-pendulum", "look", "study.yaml"],
        ["looping-pendulum", "identify", "study.yaml", "--out", "report"],
    ]


def rod_radius(case: Case) -> str:
    """Return how `track` and `new study` take the rod's radius."""
    return f"{1e3 * case.stated_rod_radius:.3f} mm +/- {100 * case.rod_error:g} %"


def judged(folder: Path, case: Case) -> dict[str, Any]:
    """Type the commands in a fresh folder beside the films, and return what came of it."""
    start = time.process_time()
    films = rendered(folder, case)
    row: dict[str, Any] = {"seed": case.seed, "kind": str(case), "hidden": case.hidden or "nothing", "cpu": {}}
    row["cpu"]["render"] = time.process_time() - start
    run = films / "run"
    shutil.rmtree(run, ignore_errors=True)
    run.mkdir()
    for film in films.glob("t?.mp4"):
        os.link(film, run / film.name)
    notes: list[str] = []
    for argv in commands(case):
        code, said, seconds = _typed(argv, run)
        row["cpu"][argv[1]] = row["cpu"].get(argv[1], 0.0) + seconds
        with (run / "typed.txt").open("a") as log:
            log.write(f"$ {shlex.join(argv)}\n{said}[exit {code}, {seconds:.1f} s]\n\n")
        if code and argv[1] in ("track", "new"):
            return row | _releases(films, run) | {"result": "refused", "said": f"{argv[1]}: {_sentence(said)}"}
        if code and argv[1] == "look":
            notes.append(f"look exits {code}: {_sentence(said)}")
    row |= _releases(films, run) | {"notes": notes}
    if not (run / "report/verdict.json").exists():
        return row | {"result": "refused", "said": f"identify: {_sentence(said)}"}
    return row | _verdict(json.loads((run / "report/verdict.json").read_text()), case)


def _typed(argv: list[str], folder: Path) -> tuple[int, str, float]:
    """Return exit status, output, and CPU time [s] of a command in its own process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "looping_pendulum", *argv[1:]], cwd=folder, env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=COMMAND_SECONDS,
        )  # fmt: skip
        code, said = done.returncode, done.stdout
    except subprocess.TimeoutExpired:
        code, said = -1, f"no end within {COMMAND_SECONDS} s\n"
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return code, said, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _sentence(said: str) -> str:
    """Return the error of an output, or its end."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    errors = [k for k, line in enumerate(lines) if line.lower().startswith(("error", "looping-pendulum:"))]
    return " ".join(lines[errors[-1] :] if errors else lines[-3:])[:400]


def _releases(films: Path, run: Path) -> dict[str, Any]:
    """Return errors of angle and release of each tracked film over their stated errors; None: not shown."""
    from looping_pendulum.measured.film.record import read_record

    angles: list[float | None] = []
    releases: list[float | None] = []
    for film in json.loads((films / "truth.json").read_text())["films"]:
        record = run / Path(film["file"]).with_suffix(".film.json")
        released = read_record(record.read_bytes()).release if record.exists() else None
        shown = released is not None and released.angle_error is not None
        angles.append(
            (math.degrees(released.angle) - film["angle_deg"]) / math.degrees(released.angle_error) if shown else None
        )
        releases.append(None if released is None else (released.time - film["release_s"]) / released.time_error)
    return {"angles": angles, "releases": releases}


def _verdict(tree: dict[str, Any], case: Case) -> dict[str, Any]:
    credible = [one for one in tree["explanations"] if one["credible"]]
    named = [
        {OTHER_NAMES.get(e["name"], e["name"]) for e in one["effects"]} | ({"law"} if one["law"] else set()) for one in credible
    ]
    # Every film has a camera that is a little aside, and a lens
    wanted = {case.hidden} if case.hidden else set()
    fits = [names - OF_A_CAMERA == wanted for names in named]
    verdict = tree["verdict"]
    if verdict in ("identified", "no_missing_effect") and fits and all(fits):
        result = "right"
    elif verdict == "interrupted":
        result = "refused"
    else:
        result = "tied" if verdict == "ambiguous" and any(fits) else "wrong"
    shown = [
        f"{'+'.join(sorted(names)) or 'nothing'} {one['probability'] or 0:.2f}"
        for names, one in zip(named, credible, strict=True)
    ]
    return {"result": result, "verdict": verdict, "named": shown, "said": tree["sentence"]}


def _line(row: dict[str, Any]) -> str:
    def errors(values: list[float | None]) -> str:
        return " ".join("?" if v is None else f"{v:+.1f}" for v in values)

    cpu = ", ".join(f"{name} {seconds:.0f}" for name, seconds in row["cpu"].items())
    head = f"{row['seed']} {row['result'].upper():7} hidden {row['hidden']}: {row.get('verdict', '')} {row.get('named', '')}"
    tail = [
        f"    {row['kind']}",
        f"    angle {errors(row['angles'])}, release {errors(row['releases'])} stated errors; CPU s: {cpu}",
    ]
    tail += [f"    {row['said']}"] if row["result"] in ("refused", "wrong") else []
    return "\n".join([head, *tail, *(f"    {note}" for note in row.get("notes", []))])


def _study(task: tuple[int, str, bool, bool]) -> dict[str, Any]:
    seed, folder, only_render, clean = task
    case, place = drawn(seed, clean=clean), Path(folder) / str(seed)
    if only_render:
        start = time.process_time()
        rendered(place, case)
        return {"seed": seed, "cpu": time.process_time() - start, "kind": str(case), "hidden": case.hidden or "nothing"}
    return judged(place, case)


def _release(task: tuple[int, str]) -> dict[str, Any]:
    """Track one film with exact values, and return errors of its release."""
    from looping_pendulum.errors import HarnessError
    from looping_pendulum.measured.film.record import TrackSettings
    from looping_pendulum.measured.film.track import track

    seed, folder = task
    case = released(seed)
    place = rendered(Path(folder) / f"release_{seed}", case)
    film = json.loads((place / "truth.json").read_text())["films"][0]
    known = {f.name for f in fields(TrackSettings)}
    stated = {
        "free_length": case.stated_free_length, "free_length_error": LENGTH_ERROR, "rod_radius": case.stated_rod_radius,
        "rod_radius_error": case.rod_error * case.stated_rod_radius,
    }  # fmt: skip
    row: dict[str, Any] = {"seed": seed, "kind": str(case)}
    try:
        found = track(place / "t1.mp4", TrackSettings(**{name: value for name, value in stated.items() if name in known}))
    except HarnessError as error:
        return row | {"said": str(error)}
    angle_error = ANGLE_ERROR if found.release.angle_error is None else found.release.angle_error
    return row | {
        "release": (found.release.time - film["release_s"]) / found.release.time_error,
        "release_error_ms": 1e3 * found.release.time_error,
        "angle": (found.release.angle - math.radians(film["angle_deg"])) / angle_error,
        "angle_error_deg": math.degrees(angle_error),
    }


def _release_line(row: dict[str, Any]) -> str:
    if "said" in row:
        return f"{row['seed']} REFUSED ({row['kind']}): {row['said']}"
    return (
        f"{row['seed']} release {row['release']:+.2f} of {row['release_error_ms']:.2f} ms, "
        f"angle {row['angle']:+.2f} of {row['angle_error_deg']:.2f} deg ({row['kind']})"
    )


def main() -> None:
    """Run the studies or the releases."""
    parser = argparse.ArgumentParser(prog="python -m research.films_of_strangers", description=main.__doc__)
    parser.add_argument("--seeds", default="900-939", help="first and last seed of the studies")
    parser.add_argument(
        "--folder", default=str(Path(tempfile.gettempdir()) / "strangers"), help="where films and reports are kept"
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--clean", action="store_true", help="hide nothing in any")
    parser.add_argument("--only-render", action="store_true")
    parser.add_argument("--releases", type=int, default=0, help="track so many single films instead")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    with ProcessPoolExecutor(options.jobs) as pool:
        if options.releases:
            rows = []
            for row in pool.map(_release, [(seed, options.folder) for seed in range(options.releases)]):
                rows.append(row)
                print(_release_line(row), flush=True)
            for name in ("release", "angle"):
                z = np.array([row[name] for row in rows if name in row])
                print(
                    f"{name}: {len(z)} of {len(rows)} films, within 1 stated error {np.mean(np.abs(z) < 1):.0%}, "
                    f"within 2 {np.mean(np.abs(z) < 2):.0%}, bias {np.mean(z):+.2f} of it, scatter {np.std(z):.2f}"
                )
            return
        counts: Counter[str] = Counter()
        tasks = [
            (seed, options.folder, options.only_render, options.clean) for seed in range(int(first), int(last or first) + 1)
        ]
        for row in pool.map(_study, tasks):
            print(row if options.only_render else _line(row), flush=True)
            counts[row.get("result", "rendered")] += 1
        print(", ".join(f"{name} {count}" for name, count in counts.most_common()))


if __name__ == "__main__":
    main()

"""Compare MJX, on a CPU, with MuJoCo on this package's tendon model: lengths over the rod, and whole runs.

`python -m research.mjx_parity lengths` computes the lengths of both tendons at many wrap angles, and
`python -m research.mjx_parity runs` (many minutes) makes runs with MJX's step in place of MuJoCo's, while the rest of the
adapter (which tendon is in use, the string's turning, the applied forces, and the forward pass from which the capstan bound is
derived) stays as it is. Both need mujoco-mjx and jax, which no extra of this package installs, and store what they find in
research/data/mjx_parity.json.
"""

import argparse
import dataclasses
import datetime
import json
import math
import time
from typing import Any

import numpy as np

from looping_pendulum.engines.mujoco import tendon
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.files import write_atomically
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.runs.trajectory import Trajectory
from looping_pendulum.scenarios import load
from looping_pendulum.versions import installed_version
from research import DATA

FILE = DATA / "mjx_parity.json"
VARIANTS = ("mujoco:documented", "mujoco:capstan")
WRAP_ANGLES = (120, 180, 210, 220, 240, 270, 300, 360)
"""[deg]; tendon "even" is right to 240 deg, and tendon "odd" from 180 to 420 deg."""
FREE_LENGTH, HANGING_LENGTH = 0.5, 0.2
"""[m], at which the tendons' lengths are compared."""
DURATION = 0.7
"""Simulated time [s]."""
STATE = ("qpos", "qvel", "qacc_warmstart", "time")


class MjxStep:
    """MJX's step with the signature of `mujoco.mj_step`, in double precision, compiled at its first use."""

    def __init__(self) -> None:
        self._steps: dict[bytes, Any] = {}
        self.compile_seconds = 0.0
        """CPU time of the compilations [s]; a tendon in use is a compilation of its own, since MJX takes limits as fixed."""

    def __call__(self, model: Any, data: Any) -> None:
        """Advance ``data`` by one step of ``model``."""
        key = model.tendon_limited.tobytes()
        arguments = [np.array(getattr(data, name)) for name in (*STATE, "qfrc_applied")]
        arguments += [np.array(model.tendon_range), np.array(model.dof_frictionloss)]
        began = time.process_time()
        first = key not in self._steps
        if first:
            self._steps[key] = self._compiled(model, data)
        qpos, qvel, warmstart, now, qacc = (np.asarray(one) for one in self._steps[key](*arguments))
        if first:
            self.compile_seconds += time.process_time() - began
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:], data.qacc[:] = qpos, qvel, warmstart, qacc
        data.time = float(now)

    @staticmethod
    def _compiled(model: Any, data: Any) -> Any:
        import jax
        from mujoco import mjx

        mjx_model, mjx_data = mjx.put_model(model), mjx.put_data(model, data)

        def step(qpos: Any, qvel: Any, warmstart: Any, now: Any, applied: Any, ranges: Any, friction_loss: Any) -> Any:
            before = mjx_data.replace(qpos=qpos, qvel=qvel, qacc_warmstart=warmstart, time=now, qfrc_applied=applied)
            after = mjx.step(mjx_model.replace(tendon_range=ranges, dof_frictionloss=friction_loss), before)
            return *(getattr(after, name) for name in STATE), after.qacc

        return jax.jit(step)


def run(engine: Engine, step: MjxStep | None) -> tuple[Trajectory, float]:
    """Return a run of ``engine`` and its CPU time [s]; with ``step``, that is MuJoCo's step."""
    original = tendon.TendonRig.__init__

    def with_step(rig: Any, *arguments: Any, **options: Any) -> None:
        original(rig, *arguments, **options)
        if step is not None:
            rig._mj_step = step

    tendon.TendonRig.__init__ = with_step  # type: ignore[method-assign]
    began = time.process_time()
    try:
        made = engine.simulate(dataclasses.replace(load("ten_to_one"), duration=DURATION)).raise_if_failed()
    finally:
        tendon.TendonRig.__init__ = original  # type: ignore[method-assign]
    return made, time.process_time() - began


def parity(engine: Engine) -> dict[str, Any]:
    """Return the largest distance between the two runs' light masses, and the CPU seconds per simulated second of each."""
    step = MjxStep()
    (own, own_seconds), (other, seconds) = run(engine, None), run(engine, step)
    apart = np.linalg.norm(own.light_position - other.light_position, axis=1)
    return {
        "variant": f"{engine.name}:{engine.variant}",
        "largest_distance": float(apart.max()),
        "cpu_per_second": own_seconds / DURATION,
        "mjx_cpu_per_second": (seconds - step.compile_seconds) / DURATION,
        "mjx_compile_cpu": step.compile_seconds,
    }


def lengths(engine: Engine) -> list[dict[str, float]]:
    """Return, for each wrap angle, the error [m] of each tendon's length in MuJoCo and in MJX against the closed form."""
    import jax
    import mujoco
    from mujoco import mjx

    p = load("ten_to_one").parameters
    model = mujoco.MjModel.from_xml_string(tendon.model_xml(p, engine.settings))
    data = mujoco.MjData(model)
    mjx_model, mjx_data = mjx.put_model(model), mjx.put_data(model, data)
    mjx_lengths = jax.jit(lambda qpos: mjx.forward(mjx_model, mjx_data.replace(qpos=qpos)).ten_length)
    rows = []
    for degrees in WRAP_ANGLES:
        angle = math.radians(degrees)
        data.qpos[:] = (*light_position(math, FREE_LENGTH, angle, p.rod_radius), -HANGING_LENGTH)
        mujoco.mj_fwdPosition(model, data)
        exact = FREE_LENGTH + HANGING_LENGTH + p.rod_radius * angle
        row = {"wrap_angle_degrees": float(degrees)}
        for name, values in (("mujoco", data.ten_length), ("mjx", np.asarray(mjx_lengths(np.array(data.qpos))))):
            row |= {f"{name}_even": float(values[0] - exact), f"{name}_odd": float(values[1] - exact)}
        rows.append(row)
    return rows


def main() -> None:
    """Compare and store."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["lengths", "runs"])
    what = parser.parse_args().what
    import jax

    jax.config.update("jax_enable_x64", True)  # single precision by default
    engines = select(VARIANTS, Profile.QUICK)
    result = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    result |= {
        "command": "python -m research.mjx_parity",
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "versions": {name: installed_version(name) for name in ("mujoco", "mujoco-mjx", "jax")},
        what: lengths(engines[0]) if what == "lengths" else [parity(engine) for engine in engines],
    }
    write_atomically(FILE, json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()

"""Run a MuJoCo tendon variant with MJX's step in place of MuJoCo's, and store how far apart the two runs are.

`python -m benchmarks.mjx_parity` needs mujoco-mjx and jax, which no extra of this package installs; no GPU is needed. The rest
of the adapter (which tendon is in use, the string's turning, the applied forces, and the forward pass from which the capstan
bound is derived) stays as it is. The result is docs/data/mjx_parity.json.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.compare.export import write_atomically
from looping_pendulum.engines.mujoco import tendon_rig
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.scenarios import load
from looping_pendulum.versions import installed_version

FILE = Path(__file__).parents[1] / "docs" / "data" / "mjx_parity.json"
VARIANTS = ("mujoco:documented", "mujoco:capstan")
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
    original = tendon_rig.TendonRig.__init__

    def with_step(rig: Any, *arguments: Any, **options: Any) -> None:
        original(rig, *arguments, **options)
        if step is not None:
            rig._mj_step = step

    tendon_rig.TendonRig.__init__ = with_step  # type: ignore[method-assign]
    began = time.process_time()
    try:
        made = engine.simulate(dataclasses.replace(load("ten_to_one"), duration=DURATION)).raise_if_failed()
    finally:
        tendon_rig.TendonRig.__init__ = original  # type: ignore[method-assign]
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


def main() -> None:
    """Run and store."""
    import jax

    jax.config.update("jax_enable_x64", True)  # single precision by default
    rows = [parity(engine) for engine in select(VARIANTS, Profile.QUICK)]
    result = {
        "command": "python -m benchmarks.mjx_parity",
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "versions": {name: installed_version(name) for name in ("mujoco", "mujoco-mjx", "jax")},
        "runs": rows,
    }
    write_atomically(FILE, json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()

"""Two point masses and a tendon over a fixed roller in Newton's XPBD solver, on the CPU: all calls of Newton and Warp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from looping_pendulum.engines.newton.settings import NewtonTendonSettings
from looping_pendulum.reference_ode.geometry import Array

Vector = tuple[float, float]
"""Components x and y, SI."""

INERTIA_RADIUS = 1e-3
"""Radius of gyration of a mass [m]. No torque acts on one, so it changes nothing, but Newton replaces an inertia of zero."""
CLOCKWISE = -1
"""Newton's sign for the side on which the string passes the rod, from the light mass to the heavy one."""
DEVICE = "cpu"


class NewtonWorld:
    """A world of Newton: first masses and a string are added, then `start` is called, then `advance`.

    Parameters
    ----------
    gravity
        Downward acceleration [m/s^2].
    settings
        Numerical settings.
    """

    def __init__(self, gravity: float, settings: NewtonTendonSettings) -> None:
        import warp

        # Compiled once for each version of Newton, in half a minute; with the gradients that nobody asks for here, in minutes
        warp.config.enable_backward = False
        import newton

        self._warp, self._newton = warp, newton
        self._settings, self._unit = settings, settings.length_unit
        self._builder: Any = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0.0, -gravity / self._unit, 0.0))
        self._velocities: list[Vector] = []
        self._has_string = False

    def add_mass(self, position: Vector, velocity: Vector, mass: float) -> int:
        """Add a point mass [m, m/s, kg] and return its index."""
        wp = self._warp
        inertia = mass * (INERTIA_RADIUS / self._unit) ** 2
        body: int = self._builder.add_body(
            xform=wp.transform(p=wp.vec3(*self._place(position))),
            mass=mass,
            inertia=wp.mat33(inertia, 0.0, 0.0, 0.0, inertia, 0.0, 0.0, 0.0, inertia),
            lock_inertia=True,
        )
        self._velocities.append(velocity)
        return body

    def add_string(self, light: int, heavy: int | Vector, rod_radius: float, friction: float) -> None:
        """Add the string from the mass ``light`` over the rod to the mass ``heavy``, or to a fixed point [m]."""
        guide, kind = self._newton.TendonGuide, self._newton.TendonGuideType
        # Both are the same in every unit of length
        span = {"compliance": self._settings.compliance, "damping": self._settings.damping}
        rod = {"radius": rod_radius / self._unit, "orientation": CLOCKWISE, "mu": friction}
        end = {"body": heavy} if isinstance(heavy, int) else {"body": -1, "offset": self._place(heavy)}
        self._builder.add_tendon(
            [
                guide(body=light, guide_type=kind.ANCHOR),
                guide(body=-1, guide_type=kind.ROLLER, **rod, **span),
                guide(guide_type=kind.ANCHOR, **end, **span),
            ]
        )
        self._has_string = True

    def start(self) -> None:
        """End the building: make the solver, and record a group of steps as a graph."""
        s, wp = self._settings, self._warp
        self._model = self._builder.finalize(device=DEVICE)
        self._solver = self._newton.solvers.SolverXPBD(
            self._model,
            iterations=s.iterations,
            joint_linear_relaxation=s.relaxation,
            tendon_settle_tol=s.settle_tolerance,
        )
        self._states = self._model.state(), self._model.state()
        velocities = np.zeros((len(self._velocities), 6))
        velocities[:, :2] = np.array(self._velocities) / self._unit
        self._states[0].body_qd.assign(velocities)
        self._forces = np.zeros_like(velocities)
        self._rest_lengths_at_release = self._rest_lengths()
        with wp.ScopedCapture(device=DEVICE) as capture:
            self._step_group()
        self._graph = capture.graph

    def advance(self, forces: Sequence[Vector]) -> None:
        """Advance by a group of steps, with these forces [N] on the masses."""
        if forces:
            self._forces[:, :2] = np.array(forces) / self._unit
            for state in self._states:
                state.body_f.assign(self._forces)
        self._warp.capture_launch(self._graph)

    def positions(self) -> Array:
        """Return the masses' positions [m], shape (n, 2)."""
        return np.asarray(self._states[0].body_q.numpy()[:, :2] * float(self._unit), dtype=float)

    def velocities(self) -> Array:
        """Return the masses' velocities [m/s], shape (n, 2)."""
        return np.asarray(self._states[0].body_qd.numpy()[:, :2] * float(self._unit), dtype=float)

    def stretch_and_slip(self) -> Vector:
        """Return by how much the string is longer than at rest, and how far it has slid to the heavy side [m]."""
        rest = self._rest_lengths()
        stretch = self._lengths().sum() - rest.sum()
        return float(stretch), float(rest[1] - self._rest_lengths_at_release[1])

    def _step_group(self) -> None:
        control = self._model.control(clone_variables=False)
        first, second = self._states
        for _ in range(self._settings.steps_per_group // 2):
            self._solver.step(first, second, control, None, self._settings.time_step)
            self._solver.step(second, first, control, None, self._settings.time_step)

    def _rest_lengths(self) -> Array:
        """Return the rest lengths of the straight parts, light side first [m]."""
        return self._read(self._solver.tendon_segment_rest_length)

    def _lengths(self) -> Array:
        return self._read(self._solver.tendon_segment_length)

    def _read(self, values: Any) -> Array:
        return np.asarray(values.numpy(), dtype=float) * self._unit if self._has_string else np.zeros(0)

    def _place(self, position: Vector) -> tuple[float, float, float]:
        return position[0] / self._unit, position[1] / self._unit, 0.0

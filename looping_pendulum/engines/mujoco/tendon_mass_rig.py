"""The spatial tendon of `tendon_model`, with a heavy mass that carries the friction."""

from __future__ import annotations

from looping_pendulum.engines.mujoco.effective_mass_rig import HEAVY, EffectiveMassRig
from looping_pendulum.engines.mujoco.tendon_model import EffectiveMassSettings, model_xml
from looping_pendulum.engines.mujoco.winding import SWITCH_DOWN, SWITCH_UP, TAUT, TurnTaking
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.geometry import string_followed
from looping_pendulum.reference_ode.parameters import Parameters


class TendonMassRig(EffectiveMassRig):
    """Two slides for the light mass; the string is two tendons used in turn."""

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, end_length: float) -> None:
        super().__init__(parameters, settings, model_xml(parameters, settings, simple=settings.simple), end_length)
        self._wrap_angle = parameters.release_angle
        # MuJoCo leaves the string's turning (l omega^2) out of a tendon's acceleration, so the length allowed is shifted by
        # what pulls just as much.
        softness = settings.impedance * settings.string_time_constant
        self._turning_shift = softness * softness if settings.corrections else 0.0
        self._turns = TurnTaking(parameters, self._model, SWITCH_UP, SWITCH_DOWN) if self._has_string else None
        self._qvel[:HEAVY] = self._release_velocity[:HEAVY]
        self._start()

    def _light(self, ahead: float = 0.0) -> tuple[float, float, float, float]:
        x, y, *_ = self._qpos.tolist()
        vx, vy, *_ = self._qvel.tolist()
        ax, ay, *_ = self._qacc.tolist()
        return x + ahead * vx, y + ahead * vy, vx + ahead * ax, vy + ahead * ay

    def _string(self, ahead: float = 0.0) -> tuple[float, float]:
        x, y, _, _ = self._light(ahead)
        free_length, self._wrap_angle = string_followed(x, y, self._parameters.rod_radius, self._wrap_angle)
        return free_length, self._wrap_angle

    def _generalized(self, fx: float, fy: float) -> tuple[float, float]:
        return fx, fy

    def _prepare(self, kinematics: Kinematics) -> None:
        if self._turns is not None:
            self._turns.follow(kinematics.wrap_angle)
            across = kinematics.across_speed
            shift = self._turning_shift / (self._divided * self._divided)
            self._turns.allow(self._caught - TAUT - shift * across * across / kinematics.free_length)

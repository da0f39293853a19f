"""MuJoCo rig with the spatial tendon of `tendon_model` and friction as a factor on the heavy mass."""

from __future__ import annotations

from looping_pendulum.engines.mujoco.effective_mass_rig import HEAVY_DOF, EffectiveMassRig
from looping_pendulum.engines.mujoco.tendon_model import EffectiveMassSettings, model_xml
from looping_pendulum.engines.mujoco.winding import SWITCH_DOWN, SWITCH_UP, TAUT_MARGIN, AlternatingTendons
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.geometry import next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters


class TendonMassRig(EffectiveMassRig):
    """The rig with two slides for the light mass and two tendons, used in turn, for the string."""

    def __init__(self, parameters: Parameters, settings: EffectiveMassSettings, end_length: float) -> None:
        super().__init__(parameters, settings, model_xml(parameters, settings, simple=settings.simple), end_length)
        self._wrap_angle = parameters.release_angle
        # MuJoCo leaves the string's turning (l omega^2) out of a tendon's acceleration. The string's length limit is shifted by
        # the amount that pulls equally strongly.
        softness = settings.impedance * settings.string_time_constant
        self._turning_shift = softness * softness if settings.corrections else 0.0
        self._tendons = AlternatingTendons(parameters, self._model, SWITCH_UP, SWITCH_DOWN) if self._has_string else None
        self._qvel[:HEAVY_DOF] = self._release_velocity[:HEAVY_DOF]
        self._initialise()

    def _light_mass_state(self, ahead: float = 0.0) -> tuple[float, float, float, float]:
        x, y, *_ = self._qpos.tolist()
        vx, vy, *_ = self._qvel.tolist()
        ax, ay, *_ = self._qacc.tolist()
        return x + ahead * vx, y + ahead * vy, vx + ahead * ax, vy + ahead * ay

    def _string_coordinates(self, ahead: float = 0.0) -> tuple[float, float]:
        x, y, _, _ = self._light_mass_state(ahead)
        free_length, self._wrap_angle = next_string_coordinates(x, y, self._parameters.rod_radius, self._wrap_angle)
        return free_length, self._wrap_angle

    def _generalized_force(self, fx: float, fy: float) -> tuple[float, float]:
        return fx, fy

    def _prepare(self, kinematics: Kinematics) -> None:
        if self._tendons is not None:
            self._tendons.select(kinematics.wrap_angle)
            transverse_speed = kinematics.across_speed
            # Substeps divide the time constant, of which the shift is the square
            shift = self._turning_shift / (self._substeps * self._substeps)
            self._tendons.allow_extra_length(
                self._catch_stretch - TAUT_MARGIN - shift * transverse_speed * transverse_speed / kinematics.free_length
            )

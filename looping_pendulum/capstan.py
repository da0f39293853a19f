"""The capstan law for a tendon of a MuJoCo model: the bound of its friction at every step, so that it slips and sticks.

MuJoCo's tendons slide over what they wrap without friction: one tension T acts along the whole tendon. The capstan law wants
T e^(mu theta) on the side towards which the string slides. The difference is a force on one side alone, and MuJoCo has a
constraint that exerts such a force up to a bound and holds what the bound can hold: the friction loss. `CapstanTendon` gives
that bound anew before every step. `StringResponse` is what this package's own variant mujoco:capstan decides by, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.errors import HarnessError

NO_FRICTION = 1e-12
"""A friction loss [N] of practically zero that keeps the friction's constraint row; at 0 MuJoCo leaves the row out."""
REST_SPEED = 1e-5
"""Below this speed [m/s] string counts as at rest; string that is held creeps at 1e-6 m/s or less."""
TRIAL_FRACTION = 0.5
"""Friction of the trial with which `CapstanTendon` measures the string's response, as a fraction of the tension.

Less than the whole, so that the trial does not make the string slack.
"""


class CapstanError(HarnessError, ValueError):
    """A model lacks what `CapstanTendon` needs."""


@dataclass(frozen=True, kw_only=True)
class StringResponse:
    """What taut string does without friction on the rod, and how friction changes it; both are linear in the friction.

    Friction is a force along the string on one of its sides, the braked side. Speeds and accelerations are those with which
    that side shortens, and friction is positive if it pulls in that direction.
    """

    tension: float
    """Tension on the other side, without friction [N]."""
    acceleration: float
    """Acceleration with which the braked side shortens, without friction [m/s^2]."""
    mass: float
    """Friction over the acceleration that it adds [kg]."""
    tension_share: float
    """Tension on the other side that a unit of friction takes away."""

    def friction(self, exponent: float) -> float:
        """Return the friction [N] at which the tension of the other side is e^exponent times that of the braked side.

        ``exponent`` is mu theta where the braked side shortens, and -mu theta where it lengthens. With T the tension of the
        other side without friction, F = (T - share F) (e^-exponent - 1) is solved for F.
        """
        ratio = math.expm1(-exponent)
        return ratio * self.tension / (1 + self.tension_share * ratio)

    def bound(
        self, speed: float, sliding: float, holding: float, time_step: float, rest_speed: float = REST_SPEED
    ) -> tuple[float, float]:
        """Return the bound of the friction in the coming step, and the force that is missing if the string turns round in it.

        Parameters
        ----------
        speed
            Speed with which the braked side shortens [m/s].
        sliding, holding
            mu theta of string that slides and of string at rest.
        time_step
            Length of the step [s].
        rest_speed
            Below this speed [m/s] the string counts as at rest.

        Returns
        -------
        bound : float
            Largest friction, in either direction [N].
        missing_force : float
            Further friction [N] until the string turns round within the step; 0 where it does not.
        """
        before, fraction = 0.0, 0.0
        if abs(speed) > rest_speed:
            before = self.friction(math.copysign(sliding, speed))
            acceleration = self.acceleration + before / self.mass
            if speed * (speed + acceleration * time_step) > 0:
                return max(abs(before), NO_FRICTION), 0.0
            fraction = -speed / acceleration / time_step  # of the step, until the string stops
        holding_force = -self.mass * self.acceleration  # keeps the string at rest
        bound = self.friction(math.copysign(holding, -holding_force))
        if abs(holding_force) <= abs(bound):
            return max(abs(before), abs(bound), NO_FRICTION), 0.0  # the engine's constraint stops and holds it
        after = self.friction(math.copysign(sliding, -holding_force))
        # Until the string stops within the step, the friction of its earlier direction acts
        return max(abs(after), NO_FRICTION), (before - after) * fraction


class CapstanTendon:
    """Friction between a MuJoCo tendon and the cylinder or sphere that it wraps, by the capstan law.

    The model has two spatial tendons. The one is the string: from its first end over the cylinder to its second end, with its
    length limited (``limited="true" range="0 LENGTH"``), with stiffness, or pulled by an actuator. The other, the *braked
    side*, has no limit and no stiffness: from the same first end over the same cylinder to a site that is fixed to the
    cylinder's body and lies on it, or beyond it on the string's way, so that its length changes only as string slides over the
    cylinder::

        <spatial name="rope" limited="true" range="0 1.2" solreflimit="4e-4 1" solimplimit="0.9999 0.9999">
          <site site="load"/><geom geom="rod" sidesite="above"/><site site="winch"/></spatial>
        <spatial name="side" solreffriction="4e-4 1" solimpfriction="0.9999 0.9999">
          <site site="load"/><geom geom="rod" sidesite="above"/><site site="mark"/></spatial>

    The solver attributes matter: with MuJoCo's own, string that is held creeps and string under load stretches. Then::

        capstan = CapstanTendon(model, data, tendon="rope", side="side", friction=0.3)
        while data.time < 1.0:
            capstan.prepare()
            mujoco.mj_step(model, data)

    `prepare` asks MuJoCo for the forces twice, without friction and with a trial's, as the tension depends on the friction.
    One friction coefficient serves string that slides and string at rest. Where the string turns round within a step and does
    not stick, the step's friction is that of the later direction, an error of first order in the step.

    Parameters
    ----------
    model, data
        MuJoCo's `MjModel` and `MjData`. The friction loss of the braked side in ``model`` is overwritten.
    tendon
        Name of the string.
    side
        Name of the braked side.
    friction
        Coefficient mu between string and cylinder.

    Raises
    ------
    CapstanError
        If there are no such tendons, one wraps nothing, the string runs over a pulley or has a stiffness that is not linear, or
        the coefficient is negative.
    """

    def __init__(self, model: Any, data: Any, *, tendon: str, side: str, friction: float) -> None:
        import mujoco

        if not friction >= 0:
            raise CapstanError(f"friction: found {friction!r}, needed a coefficient of 0 or more")
        self._mujoco, self._model, self._data = mujoco, model, data
        self._tendon, self._side = self._wrapping_tendon(tendon), self._wrapping_tendon(side)
        if np.any(model.tendon_stiffnesspoly[self._tendon]) or np.any(model.tendon_dampingpoly[self._tendon]):
            raise CapstanError(f"tendon '{tendon}': found stiffness or damping that is not linear, needed linear ones")
        self._actuators = [
            i
            for i in range(model.nu)
            if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_TENDON and model.actuator_trnid[i, 0] == self._tendon
        ]
        self.friction = friction
        """Coefficient mu; it may be changed between steps."""

    @property
    def wrap_angle(self) -> float:
        """Angle over which the string lies on what it wraps [rad], as MuJoCo last computed its path."""
        model, data = self._model, self._data
        first, count = data.ten_wrapadr[self._tendon], data.ten_wrapnum[self._tendon]
        points = data.wrap_xpos.reshape(-1, 3)[first : first + count]
        geoms = data.wrap_obj.reshape(-1)[first : first + count]
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        wrapped = (geoms[:-1] >= 0) & (geoms[:-1] == geoms[1:])
        if not wrapped.any():
            return 0.0
        # MuJoCo keeps the two tangent points only, so the arc is what the straight parts leave of the length
        arc = data.ten_length[self._tendon] - lengths[~wrapped].sum()
        return float(arc / model.geom_size[geoms[:-1][wrapped][0], 0])

    @property
    def tensions(self) -> tuple[float, float]:
        """Tension of the string on the braked side and on the other side [N], as MuJoCo last computed its forces."""
        other = self._tension()
        return other + self._friction_force(), other

    def prepare(self) -> None:
        """Set the bound of the friction for the coming step."""
        tension, acceleration = self._solve(NO_FRICTION)
        bound = NO_FRICTION
        exponent = self.friction * self.wrap_angle
        if tension > 0.0 and exponent > 0.0:
            trial_tension, trial_acceleration = self._solve(TRIAL_FRACTION * tension)
            force, change = self._friction_force(), trial_acceleration - acceleration
            speed = -float(self._data.ten_velocity[self._side])
            if force * change > 0.0:
                response = StringResponse(
                    tension=tension,
                    acceleration=acceleration,
                    mass=force / change,
                    tension_share=(tension - trial_tension) / force,
                )
                bound, _ = response.bound(speed, exponent, exponent, self._model.opt.timestep)
            else:  # balanced without friction, so that the trial found nothing to hold
                bound = -math.expm1(-exponent) * tension
        self._model.tendon_frictionloss[self._side] = bound

    def _solve(self, bound: float) -> tuple[float, float]:
        """Return the tension [N] and the acceleration with which the braked side shortens [m/s^2], under this bound."""
        self._model.tendon_frictionloss[self._side] = bound
        self._mujoco.mj_forward(self._model, self._data)
        accelerations = np.empty(self._data.nefc)
        self._mujoco.mj_mulJacVec(self._model, self._data, accelerations, self._data.qacc)
        return max(self._tension(), 0.0), -float(accelerations[self._friction_rows()].sum())

    def _wrapping_tendon(self, name: str) -> int:
        """Return the index of a tendon that wraps something and runs over no pulley."""
        mujoco, model = self._mujoco, self._model
        tendon: int = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, name)
        if tendon < 0:
            names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, i) for i in range(model.ntendon)]
            raise CapstanError(f"tendon: found no '{name}' in the model; choose of {', '.join(filter(None, names)) or 'none'}")
        first = model.tendon_adr[tendon]
        kinds = set(model.wrap_type[first : first + model.tendon_num[tendon]].tolist())
        if not kinds & {mujoco.mjtWrap.mjWRAP_CYLINDER.value, mujoco.mjtWrap.mjWRAP_SPHERE.value}:
            raise CapstanError(f"tendon '{name}': found nothing that it wraps, needed a geom between its sites")
        if mujoco.mjtWrap.mjWRAP_PULLEY.value in kinds:
            raise CapstanError(f"tendon '{name}': found a pulley, needed a single path")
        return tendon

    def _tension(self) -> float:
        """Return the tension of the string [N]: of its limit, its spring and its actuators."""
        model, data, tendon = self._model, self._data, self._tendon
        length, (lower, upper) = data.ten_length[tendon], model.tendon_lengthspring[tendon]
        spring = model.tendon_stiffness[tendon] * (max(length - upper, 0.0) + min(length - lower, 0.0))
        damper = model.tendon_damping[tendon] * data.ten_velocity[tendon]
        pull = sum(-model.actuator_gear[i, 0] * data.actuator_force[i] for i in self._actuators)
        limit = data.efc_force[self._rows(self._mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON, tendon)].sum()
        return float(limit + spring + damper + pull)

    def _friction_force(self) -> float:
        """Return the friction [N], positive if it pulls so as to shorten the braked side."""
        # MuJoCo's force of a row acts so as to lengthen the tendon
        return -float(self._data.efc_force[self._friction_rows()].sum())

    def _friction_rows(self) -> Any:
        """Return which constraint row is the friction of the braked side, shape (rows,)."""
        return self._rows(self._mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON, self._side)

    def _rows(self, kind: Any, tendon: int) -> Any:
        """Return which constraint rows are of this kind and of this tendon, shape (rows,)."""
        return (self._data.efc_type == kind.value) & (self._data.efc_id == tendon)

"""How a spatial tendon, which is geometry without memory, is made to wind without end."""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.reference_ode.parameters import Parameters

SWITCH_UP = math.radians(210)
"""Tendon k hands over to k + 1 when the wrap angle is this far above k pi [rad]; its path is right up to 240 degrees."""
SWITCH_DOWN = math.radians(15)
"""Tendon k hands back to k - 1 when the wrap angle is less than this above k pi [rad]; apart from `SWITCH_UP` - pi, so that a
light mass that swings to and fro there does not switch at every step."""


TAUT = 1e-9
"""The string is this much shorter [m] than it should be, so that one exactly as long as it should be counts as taut."""


class TurnTaking:
    """Uses the two tendons of `tendon_model` in turn.

    Parameters
    ----------
    parameters
        Physics.
    model
        MuJoCo's model; tendon 0 is the even one, tendon 1 the odd one.
    switch_up, switch_down
        Wrap angle above k pi at which tendon k hands over to the next and to the last [rad].
    """

    def __init__(self, parameters: Parameters, model: Any, switch_up: float, switch_down: float) -> None:
        self._limited, self._allowed = model.tendon_limited, model.tendon_range
        self._turn = 2 * math.pi * parameters.rod_radius
        self._whole_length = parameters.string_length
        self._up, self._down = switch_up, switch_down
        self._half_turns = 0
        self._use()

    def follow(self, wrap_angle: float) -> None:
        """Use the tendon that is right for ``wrap_angle`` [rad], with its turns taken off the length allowed."""
        above = wrap_angle - self._half_turns * math.pi
        if above > self._up:
            self._half_turns += 1
        elif above < self._down and self._half_turns > 0:
            self._half_turns -= 1
        else:
            return
        self._use()

    def allow(self, more: float) -> None:
        """Let the string be ``more`` [m] longer than its rest length."""
        self._allowed[self.tendon, 1] = self.rest_length + more

    def _use(self) -> None:
        self.tendon = self._half_turns % 2
        self.rest_length = self._whole_length - (self._half_turns // 2) * self._turn
        self._limited[self.tendon] = 1
        self._limited[1 - self.tendon] = 0

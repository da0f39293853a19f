"""Use two spatial tendons in turn, so that a string without memory of its turns can wind without end."""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.reference_ode.parameters import Parameters

SWITCH_UP = math.radians(210)
"""Tendon k is replaced by tendon k + 1 when the wrap angle is this far above k pi [rad]; its path is right up to 240 deg."""
SWITCH_DOWN = math.radians(15)
"""Tendon k is replaced by tendon k - 1 when the wrap angle is less than this above k pi [rad].

It differs from `SWITCH_UP` - pi, so that a light mass that swings to and fro there does not switch at every step.
"""
TAUT_MARGIN = 1e-9
"""Length by which the string's limit is reduced [m], so that a string exactly at its rest length counts as taut."""


class AlternatingTendons:
    """Activates the two tendons of `tendon_model` in turn.

    Parameters
    ----------
    parameters
        Physics.
    model
        MuJoCo's model; tendon 0 is for even numbers of half turns, tendon 1 for odd ones.
    switch_up, switch_down
        Wrap angle above k pi at which tendon k is replaced by the next and by the previous one [rad].
    """

    def __init__(self, parameters: Parameters, model: Any, switch_up: float, switch_down: float) -> None:
        self._limit_enabled, self._length_range = model.tendon_limited, model.tendon_range
        self._string_per_turn = 2 * math.pi * parameters.rod_radius
        self._string_length = parameters.string_length
        self._switch_up, self._switch_down = switch_up, switch_down
        self._half_turns = 0
        self._activate()

    def select(self, wrap_angle: float) -> None:
        """Activate the tendon that is right for ``wrap_angle`` [rad], with the wound turns subtracted from its length limit."""
        above = wrap_angle - self._half_turns * math.pi
        if above > self._switch_up:
            self._half_turns += 1
        elif above < self._switch_down and self._half_turns > 0:
            self._half_turns -= 1
        else:
            return
        self._activate()

    def allow_extra_length(self, extra: float) -> None:
        """Set the string's length limit to ``extra`` [m] more than its rest length."""
        self._length_range[self.tendon, 1] = self.rest_length + extra

    def _activate(self) -> None:
        """Enable the length limit of the current tendon, and disable that of the other."""
        self.tendon = self._half_turns % 2
        self.rest_length = self._string_length - (self._half_turns // 2) * self._string_per_turn
        self._limit_enabled[self.tendon] = 1
        self._limit_enabled[1 - self.tendon] = 0

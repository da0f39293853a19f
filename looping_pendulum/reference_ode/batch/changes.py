"""Apply release and events to many runs at once: the transition table and its choices, as in `driver`, on arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch import compiled
from looping_pendulum.reference_ode.batch.block import Block
from looping_pendulum.reference_ode.batch.compiled import LEADING, STATE, BatchModel
from looping_pendulum.reference_ode.driver import RELATIVE_TENSION_TOLERANCE, REST_SERIES_DURATION, TINY_SPEED
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Event, Mode, TransitionChoice, next_mode


class BatchTransitions:
    """Mode, signs and speeds after release and after events, for the runs of a batch.

    Each method does for all columns of a block what the method of `Driver` of like name does for one run.
    """

    def __init__(self, model: BatchModel, release: Release) -> None:
        self._model, self._release = model, release
        self._rod_radius, self._light_mass, self._gravity = (
            len(LEADING) + model.names.index(name) for name in ("rod_radius", "light_mass", "gravity")
        )

    def release(self, block: Block, push_along: Array, push_across: Array) -> None:
        """Set the modes at release, and take the first step of runs that start at rest.

        Parameters
        ----------
        block
            Zeros but for free length, wrap angle, duration and the parameters of the apparatus.
        push_along, push_across
            Speeds of the light mass at release, shape (n,) [m/s].
        """
        block["retreat_speed"], block["across_speed"] = push_along, push_across
        block["slide"] = block["heavy"] = -1.0
        block["across"] = np.where(push_across < 0, -1.0, 1.0)
        self._set_release_modes(block, push_along)
        self._set_slack_signs(block)
        self._leave_rest(block)

    def apply_event(self, block: Block, mode: Mode, event: Event) -> None:
        """Apply ``event``, at which all runs of the block, in ``mode``, have arrived."""
        following = next_mode(mode, event)
        if following is Mode.ENDED:
            block["mode"] = Mode.ENDED
        elif event is Event.ACROSS_REVERSES:
            block["across"] *= -1.0
            block["across_speed"] = TINY_SPEED * block["across"]
        elif event is Event.HEAVY_REVERSES:
            block["heavy"] *= -1.0
            block["heavy_speed"] = TINY_SPEED * block["heavy"]
        elif event in PHASE_EVENTS:
            block["phase"] = 1.0
        else:
            self._change_mode(block, mode, event, following)

    def _set_release_modes(self, block: Block, push: Array) -> None:
        """Set the modes at release; a push away from the rod acts on both masses as when a slack string becomes taut."""
        if self._release is Release.DROP:
            block["mode"] = Mode.FALLING
            return
        held = self._release is Release.HELD
        slack = Mode.CLAMPED_SLACK if held else Mode.SLACK
        if held:
            block["retreat_speed"] = np.minimum(push, 0.0)
            block["mode"] = Mode.CLAMPED
        else:
            block["mode"] = self._stick_or_slide(block)
            pushed = np.flatnonzero(push > 0)
            if len(pushed):
                pushed_runs = block.take(pushed)
                pushed_runs["mode"] = self._after_impulse(pushed_runs)
                block.table[:, pushed] = pushed_runs.table
        self._set_slide_signs(block)
        weight = block.inputs[self._light_mass] * block.inputs[self._gravity]
        least = np.where(
            block["across_speed"] >= 0, -RELATIVE_TENSION_TOLERANCE * weight, 0.0
        )  # as `Driver._min_release_tension`
        block["mode"] = np.where((push >= 0) & self._tension_is_at_least(block, least), block["mode"], slack)

    def _leave_rest(self, block: Block) -> None:
        """Take the first `REST_SERIES_DURATION` by a series where the light mass starts at rest: |v| is not analytic there."""
        rate = np.zeros((len(STATE), len(block)))
        by_series = np.zeros(len(block), dtype=bool)
        for mode in block.present_modes():
            here = block["mode"] == mode
            np.copyto(rate, compiled.rates(self._model, mode)(block.inputs), where=here)
            by_series |= here & (mode.string_moves or mode.slack)
        rates = dict(zip(STATE, rate, strict=True))
        at_rest = block["across_speed"] == 0
        block["across"] = np.where(at_rest, np.where(rates["across_speed"] >= 0, 1.0, -1.0), block["across"])
        by_series &= at_rest & (block["retreat_speed"] == 0)
        turning = rates["across_speed"] / block["free_length"]
        second_derivatives = {
            "free_length": rates["retreat_speed"] - block.inputs[self._rod_radius] * turning,
            "wrap_angle": turning,
            "slack": rates["heavy_speed"] - rates["retreat_speed"],
        }
        np.copyto(block["across_speed"], TINY_SPEED * block["across"], where=at_rest & ~by_series)
        for name in STATE:
            moved = (
                block[name]
                + REST_SERIES_DURATION * rates[name]
                + 0.5 * REST_SERIES_DURATION**2 * second_derivatives.get(name, 0.0)
            )
            np.copyto(block[name], moved, where=by_series)
        block["time"] = np.where(by_series, REST_SERIES_DURATION, 0.0)

    def _change_mode(self, block: Block, mode: Mode, event: Event, following: Mode | TransitionChoice) -> None:
        """Set the modes, and the speeds that the event sets."""
        if event is Event.STOP:
            block["heavy_speed"] = block["retreat_speed"] = 0.0
        elif mode is Mode.CLAMPED_SLACK:
            block.inputs[: len(STATE)] = self._impact(block, 0.0)[0]  # the first inputs are the state
        if following is TransitionChoice.BY_HOLDING:
            block["mode"] = self._stick_or_slide(block)
        elif following is TransitionChoice.BY_IMPULSE:
            block["mode"] = self._after_impulse(block)
        else:
            block["mode"] = following
        self._set_slide_signs(block)
        if event is Event.TAUT:
            loose = np.where(block["mode"] == Mode.CLAMPED, Mode.CLAMPED_SLACK, Mode.SLACK)
            block["mode"] = np.where(self._tension_is_at_least(block), block["mode"], loose)
        self._set_slack_signs(block)

    def _stick_or_slide(self, block: Block) -> Array:
        """Return the modes of strings that do not slide now: sticking if the rod holds them, else the way they will slide."""
        down, up = compiled.holding_margins(self._model)(block.inputs)
        return np.where(down < 0, Mode.SLIDING_DOWN, np.where(up < 0, Mode.SLIDING_UP, Mode.STICKING))

    def _after_impulse(self, block: Block) -> Array:
        """Apply an inelastic impulse along the string and return the modes after it.

        Exactly one of up, down and sticking is consistent; energy falls in each.
        """
        # All three outcomes are computed for all runs; `where` picks
        up, rising = self._impact(block, 1.0)
        down, falling = self._impact(block, -1.0)
        held, _ = self._impact(block, 0.0)
        block.inputs[: len(STATE)] = np.where(rising > 0, up, np.where(falling < 0, down, held))
        otherwise = self._stick_or_slide(block)
        return np.where(rising > 0, Mode.SLIDING_UP, np.where(falling < 0, Mode.SLIDING_DOWN, otherwise))

    def _impact(self, block: Block, slide: float) -> tuple[Array, Array]:
        """Return the state just after an inelastic impulse, and the speed at which the string then slides [m/s]."""
        out = compiled.impact(self._model, slide)(block.inputs)
        return out[:-1], out[-1]

    def _tension_is_at_least(self, block: Block, least: Array | float = 0.0) -> NDArray[np.bool_]:
        """Return where the tension of the free string is at least ``least`` [N]; true without a string, where it is 0."""
        pulls = np.ones(len(block), dtype=bool)
        for mode in block.present_modes():
            (tension,) = compiled.light_tension(self._model, mode)(block.inputs)
            np.copyto(pulls, tension >= least, where=block["mode"] == mode)
        return pulls

    def _set_slide_signs(self, block: Block) -> None:
        """Set the signs and the phase with which sliding modes begin."""
        up = block["mode"] == Mode.SLIDING_UP
        sliding = up | (block["mode"] == Mode.SLIDING_DOWN)
        np.copyto(block["slide"], np.where(up, 1.0, -1.0), where=sliding)
        np.copyto(block["phase"], np.abs(block["heavy_speed"]) > TINY_SPEED, where=sliding)

    def _set_slack_signs(self, block: Block) -> None:
        """Set the signs and the phase with which modes without tension begin."""
        falls = block["mode"] == Mode.SLACK
        slack = falls | (block["mode"] == Mode.CLAMPED_SLACK) | (block["mode"] == Mode.FALLING)
        if slack.any():
            np.copyto(block["heavy_speed"], -TINY_SPEED, where=falls & (block["heavy_speed"] == 0))
            np.copyto(block["heavy"], np.where(block["heavy_speed"] > 0, 1.0, -1.0), where=slack)
            np.copyto(block["slack"], 0.0, where=slack)
            np.copyto(block["phase"], 0.0, where=slack)

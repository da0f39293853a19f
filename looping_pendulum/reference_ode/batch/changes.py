"""What follows release and events, for many runs at once: the transition table and its choices (`driver`), on arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch import compiled
from looping_pendulum.reference_ode.batch.block import Block
from looping_pendulum.reference_ode.batch.compiled import LEADING, STATE, BatchModel
from looping_pendulum.reference_ode.driver import NO_TENSION, START, TINY
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Event, Mode, TransitionChoice, next_mode


class BatchTransitions:
    """What follows release and events in the runs of a batch."""

    def __init__(self, model: BatchModel, release: Release) -> None:
        self._model, self._release = model, release
        self._rod_radius, self._light_mass, self._gravity = (
            len(LEADING) + model.names.index(name) for name in ("rod_radius", "light_mass", "gravity")
        )

    def release(self, block: Block, push_along: Array, push_across: Array) -> None:
        """Set the modes at release, and take the first instant of what starts at rest.

        ``block``: zeros but for free length, wrap angle, the limit on the time and the numbers of the apparatus.
        """
        block["retreat_speed"], block["across_speed"] = push_along, push_across
        block["slide"] = block["heavy"] = -1.0
        block["across"] = np.where(push_across < 0, -1.0, 1.0)
        self._set_released_modes(block, push_along)
        self._enter_slack(block)
        self._leave_rest(block)

    def follow(self, block: Block, mode: Mode, event: Event) -> None:
        """Apply ``event``, which all runs, in ``mode``, have met."""
        following = next_mode(mode, event)
        if following is Mode.ENDED:
            block["mode"] = Mode.ENDED
        elif event is Event.ACROSS_REVERSES:
            block["across"] *= -1.0
            block["across_speed"] = TINY * block["across"]
        elif event is Event.HEAVY_REVERSES:
            block["heavy"] *= -1.0
            block["heavy_speed"] = TINY * block["heavy"]
        elif event in PHASE_EVENTS:
            block["phase"] = 1.0
        else:
            self._change(block, mode, event, following)

    def _set_released_modes(self, block: Block, push: Array) -> None:
        """Modes at release; a push along the string away from the rod is shared as by a string that becomes taut."""
        if self._release is Release.DROP:
            block["mode"] = Mode.FALLING
            return
        held = self._release is Release.HELD
        slack = Mode.CLAMPED_SLACK if held else Mode.SLACK
        if held:
            block["retreat_speed"] = np.minimum(push, 0.0)
            block["mode"] = Mode.CLAMPED
        else:
            block["mode"] = self._held_or_sliding(block)
            pushed = np.flatnonzero(push > 0)
            if len(pushed):
                hit = block.take(pushed)
                hit["mode"] = self._after_impulse(hit)
                block.table[:, pushed] = hit.table
        self._begin_slides(block)
        weight = block.numbers[self._light_mass] * block.numbers[self._gravity]
        least = np.where(block["across_speed"] >= 0, -NO_TENSION * weight, 0.0)  # as `Driver._least_released_tension`
        block["mode"] = np.where((push >= 0) & self._pulls(block, least), block["mode"], slack)

    def _leave_rest(self, block: Block) -> None:
        """Take the first START seconds by series where the light mass starts at rest and |v| has a root there."""
        rate = np.zeros((len(STATE), len(block)))
        by_series = np.zeros(len(block), dtype=bool)
        for mode in block.present_modes():
            here = block["mode"] == mode
            np.copyto(rate, compiled.rates(self._model, mode)(block.numbers), where=here)
            by_series |= here & (mode.string_moves or mode.slack)
        rates = dict(zip(STATE, rate, strict=True))
        at_rest = block["across_speed"] == 0
        block["across"] = np.where(at_rest, np.where(rates["across_speed"] >= 0, 1.0, -1.0), block["across"])
        by_series &= at_rest & (block["retreat_speed"] == 0)
        turning = rates["across_speed"] / block["free_length"]
        twice = {
            "free_length": rates["retreat_speed"] - block.numbers[self._rod_radius] * turning,
            "wrap_angle": turning,
            "slack": rates["heavy_speed"] - rates["retreat_speed"],
        }
        np.copyto(block["across_speed"], TINY * block["across"], where=at_rest & ~by_series)
        for name in STATE:
            moved = block[name] + START * rates[name] + 0.5 * START**2 * twice.get(name, 0.0)
            np.copyto(block[name], moved, where=by_series)
        block["time"] = np.where(by_series, START, 0.0)

    def _change(self, block: Block, mode: Mode, event: Event, following: Mode | TransitionChoice) -> None:
        """Change the modes, and the speeds that the event sets."""
        if event is Event.STOP:
            block["heavy_speed"] = block["retreat_speed"] = 0.0
        elif mode is Mode.CLAMPED_SLACK:
            block.numbers[: len(STATE)] = self._impact(block, 0.0)[0]
        if following is TransitionChoice.BY_HOLDING:
            block["mode"] = self._held_or_sliding(block)
        elif following is TransitionChoice.BY_IMPULSE:
            block["mode"] = self._after_impulse(block)
        else:
            block["mode"] = following
        self._begin_slides(block)
        if event is Event.TAUT:
            loose = np.where(block["mode"] == Mode.CLAMPED, Mode.CLAMPED_SLACK, Mode.SLACK)
            block["mode"] = np.where(self._pulls(block), block["mode"], loose)
        self._enter_slack(block)

    def _held_or_sliding(self, block: Block) -> Array:
        """Choice.BY_HOLDING: whether the rod holds a string that does not slide, and if not which way it slides."""
        down, up = compiled.holding_margins(self._model)(block.numbers)
        return np.where(down < 0, Mode.SLIDING_DOWN, np.where(up < 0, Mode.SLIDING_UP, Mode.STICKING))

    def _after_impulse(self, block: Block) -> Array:
        """Choice.BY_IMPULSE: exactly one of up, down and stick is consistent; energy falls in each."""
        up, rising = self._impact(block, 1.0)
        down, falling = self._impact(block, -1.0)
        held, _ = self._impact(block, 0.0)
        block.numbers[: len(STATE)] = np.where(rising > 0, up, np.where(falling < 0, down, held))
        otherwise = self._held_or_sliding(block)
        return np.where(rising > 0, Mode.SLIDING_UP, np.where(falling < 0, Mode.SLIDING_DOWN, otherwise))

    def _impact(self, block: Block, slide: float) -> tuple[Array, Array]:
        """State just after an inelastic pull, and the speed at which the string then slides."""
        out = compiled.impact(self._model, slide)(block.numbers)
        return out[:-1], out[-1]

    def _pulls(self, block: Block, least: Array | float = 0.0) -> NDArray[np.bool_]:
        """Whether the light mass's tension is not below ``least`` [N]; so too where there is none."""
        pulls = np.ones(len(block), dtype=bool)
        for mode in block.present_modes():
            (tension,) = compiled.light_tension(self._model, mode)(block.numbers)
            np.copyto(pulls, tension >= least, where=block["mode"] == mode)
        return pulls

    def _begin_slides(self, block: Block) -> None:
        """Set the signs and phase with which sliding modes begin."""
        up = block["mode"] == Mode.SLIDING_UP
        slides = up | (block["mode"] == Mode.SLIDING_DOWN)
        np.copyto(block["slide"], np.where(up, 1.0, -1.0), where=slides)
        np.copyto(block["phase"], np.abs(block["heavy_speed"]) > TINY, where=slides)

    def _enter_slack(self, block: Block) -> None:
        """Set the signs and phase with which modes without tension begin."""
        falls = block["mode"] == Mode.SLACK
        slack = falls | (block["mode"] == Mode.CLAMPED_SLACK) | (block["mode"] == Mode.FALLING)
        if slack.any():
            np.copyto(block["heavy_speed"], -TINY, where=falls & (block["heavy_speed"] == 0))
            np.copyto(block["heavy"], np.where(block["heavy_speed"] > 0, 1.0, -1.0), where=slack)
            np.copyto(block["slack"], 0.0, where=slack)
            np.copyto(block["phase"], 0.0, where=slack)

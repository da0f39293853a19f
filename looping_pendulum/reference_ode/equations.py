"""Equations of motion and event functions, each written once, for numbers, arrays, symbols and compiled expressions.

With u = l' + R theta' and w = l theta' (see `state`), Newton's second law in the paper's directions e1 (along, towards the rod)
and t1 (across) reads::

    M1 (w theta' - u') = T1 + F_along          M1 (w' + u theta') = F_across
    M2 u2'             = T2 + F_heavy          T2 = T1 exp(-sign(u2) X(theta))

with every force but the string's pull in F, and the capstan exponent X = mu theta. The drag on the string is divided by M1,
too, as the paper's own force balance demands; its combined equation for theta'' omits that (an erratum, see
docs/derivation.md).

Effects beyond the paper's model change the inertias (M1 along and across, M2) or the radius, or add entries to the state. A
string that also runs along the rod, by z, is S = hypot(P, z) long on the light side, P = l + R theta, so that T1 has the share
c = P / S in the plane and s = z / S along the rod. A rod that turns moves its surface by the speed v, and the string slides by
u2 - v.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

from looping_pendulum.reference_ode import effects as forces
from looping_pendulum.reference_ode.effects.library import PIVOT_FRICTION, air_drag_coefficient, heavy_swing_rates
from looping_pendulum.reference_ode.effects.types import TURN, Kinematics
from looping_pendulum.reference_ode.state import Effects, Signs, State, extra_variables, kinematics, string_path, winding
from looping_pendulum.reference_ode.transitions import Event, Mode

# Without this offset, the phases (`state.Signs.phase`) and `state.TINY_SPEED`, 57 of 2000 random apparatus had a wrong sequence
# of modes, the same 57 at every tolerance. Rounding loses 1e-18 beside an event function above 0.01 [N or m/s].
EVENT_FUNCTION_OFFSET = 1e-18
"""Added to the event function of phase 0: one that is exactly zero where it starts is not seen to fall through it."""
PASSING_SPEED_OFFSET = 1e-12
"""Added to the passing speed of a string that stretches, for the same reason; larger, as it is a difference of numbers about
1 m/s, which rounding changes by more [m/s]."""
FRICTION_CONE_TOLERANCE = 1e-12
"""Fraction of the heavy side's tension by which the rod holds more than the friction cone says.

That is the tolerance of a step. Exactly on the edge of the cone, as with equal masses and no friction, errors of this size
would decide, a hundred times in a millisecond; and |v| cannot be differentiated where a string begins to slide while
everything is at rest.
"""


class _OutOfPlaneString(NamedTuple):
    """Directions and speed of a string that also runs along the rod."""

    in_plane: Any
    """c, share of the tension T1 in the plane."""
    along_rod: Any
    """s, share of T1 along the rod."""
    speed: Any
    """S' = c u + s z', speed at which the path on the light side grows [m/s]."""
    curvature_term: Any
    """S'' - (c u' + s z'') = (u^2 + z'^2 - S'^2) / S [m/s^2]."""
    force: Any
    """Force on the light mass along the rod other than the string's [N]."""


class _Springs(NamedTuple):
    """Tensions and passing speed of the string at one instant."""

    light_tension: Any
    """T1 [N]."""
    heavy_tension: Any
    """T2 [N]."""
    passing_speed: Any
    """q', speed at which string passes to the light side [m/s]."""
    taut_margin: Any
    """Sum over both sides of the stretch and tau times its rate, e + tau e' [m]: below 0 there is no tension."""


class _ForceBalance(NamedTuple):
    """Forces and inertias of one instant."""

    k: Kinematics
    light_pull: Any
    """Tension at which the path on the light side grows at constant speed, S'' = 0; in the plane M1 w theta' - F_along [N]."""
    force_across: Any
    """F_across [N]."""
    force_on_heavy: Any
    """F_heavy [N]."""
    sliding_ratio: Any
    """T2 / T1 while sliding; else None."""
    max_holding_ratio: Any
    """Largest T2 / T1 that the rod can hold while sticking or rolling; else None."""
    light_mass: Any
    """Inertia of the light side against a pull along the string, T1 = light_pull - light_mass S'' [kg]."""
    along_mass: Any
    """Inertia of the light mass along the string, in the plane [kg]."""
    across_mass: Any
    """Inertia of the light mass across the string [kg]."""
    heavy_mass: Any
    """Inertia of the heavy mass [kg]."""
    in_plane_pull: Any
    """M1 w theta' - F_along, `light_pull` without motion along the rod [N]."""
    string_speed: Any
    """Speed at which the path on the light side grows, S' [m/s]."""
    out_of_plane: _OutOfPlaneString | None
    """None if the motion is in the plane."""
    springs: _Springs | None
    """None for a string that does not stretch."""


class Impact(NamedTuple):
    """Result of an inelastic impulse along the string: at the end of slack, or from a push at release."""

    state: State
    sliding: Any
    """Speed at which the string then slides over the rod, up being positive [m/s]."""


def _sliding_drive(b: _ForceBalance) -> Any:
    """Return (M2 + M1 T2/T1) u2' [N], the force that accelerates both masses along a sliding string."""
    return b.sliding_ratio * b.light_pull + b.force_on_heavy


def _tensions(mode: Mode, b: _ForceBalance, heavy_rate: Any) -> tuple[Any, Any]:
    """Return (T1, T2) [N], given the acceleration ``heavy_rate`` of the heavy mass [m/s^2]."""
    if mode.slack:
        return 0.0 * b.light_pull, 0.0 * b.light_pull  # zeros of the kind and shape of the other numbers
    if b.springs is not None:
        return b.springs.light_tension, b.springs.heavy_tension
    return b.light_pull - b.light_mass * heavy_rate, b.heavy_mass * heavy_rate - b.force_on_heavy


def _rod_returns(signs: Signs, y: State, rod_rate: Any) -> Any:
    """Return the event function of the rod: it falls through zero as the rod slows (phase 0) or comes to rest (phase 1)."""
    return signs.rod_phase * signs.rod * y.rod_speed + (1.0 - signs.rod_phase) * (signs.rod * rod_rate + EVENT_FUNCTION_OFFSET)


class Equations:
    """Equations of motion of one apparatus, over one math namespace.

    Parameters
    ----------
    xp
        Functions of the numbers: ``math``, ``numpy``, ``sympy``, or those of `core.expressions`.
    p
        Parameters and coefficients by name, numbers or expressions of the kind that ``xp`` takes, as from `Parameters.values`.
    effects
        Effects that act.
    """

    def __init__(self, xp: Any, p: SimpleNamespace, effects: Effects) -> None:
        self.xp, self.p, self.effects = xp, p, effects
        own = extra_variables(effects)
        self.rod_turns = "rod_speed" in own
        self.string_stretches = "light_stretch" in own
        self.leaves_plane = "sideways" in own
        self.heavy_mass_swings = "heavy_tilt" in own
        self.pivot_holds = PIVOT_FRICTION in effects

    def _force_balance(self, mode: Mode, t: Any, y: State, signs: Signs) -> _ForceBalance:
        """Return the forces and inertias from which rates, tensions and event functions follow."""
        xp, p, effects = self.xp, self.p, self.effects
        k = kinematics(xp, mode, t, y, signs, p, effects)
        force_along, force_across = forces.force_on_light_mass(xp, k, p, effects)
        force_on_heavy = forces.force_on_heavy_mass(xp, k, p, effects)
        along_mass, across_mass = forces.inertia_of_light_mass(xp, k, p, effects)
        heavy_mass = forces.inertia_of_heavy_mass(xp, k, p, effects)
        in_plane_pull = along_mass * y.across_speed * (y.across_speed / y.free_length) - force_along
        light_mass, light_pull, string_speed, out_of_plane = along_mass, in_plane_pull, y.retreat_speed, None
        if self.leaves_plane:
            out_of_plane = self._out_of_plane_string(k, y, signs)
            c, s, string_speed = out_of_plane.in_plane, out_of_plane.along_rod, out_of_plane.speed
            # S'' = c u' + s z'' + curvature term, with u' and z'' from T1: solved for T1 at S'' = 0, and for its slope
            light_mass = 1.0 / (c * c / along_mass + s * s / p.light_mass)
            light_pull = light_mass * (
                c * in_plane_pull / along_mass + s * out_of_plane.force / p.light_mass + out_of_plane.curvature_term
            )
        sliding_ratio = xp.exp(-signs.slide * forces.sliding_exponent(xp, k, p, effects)) if mode.sliding else None
        held_by_rod = mode in (Mode.STICKING, Mode.ROLLING)
        max_holding_ratio = xp.exp(forces.holding_exponent(xp, k, p, effects)) if held_by_rod else None
        stretched = None
        if self.string_stretches:
            path = string_path(xp, y, signs.overlap, p, effects)
            stretched = _springs(mode, y, string_speed, path, sliding_ratio, p)
        return _ForceBalance(
            k=k,
            light_pull=light_pull,
            force_across=force_across,
            force_on_heavy=force_on_heavy,
            sliding_ratio=sliding_ratio,
            max_holding_ratio=max_holding_ratio,
            light_mass=light_mass,
            along_mass=along_mass,
            across_mass=across_mass,
            heavy_mass=heavy_mass,
            in_plane_pull=in_plane_pull,
            string_speed=string_speed,
            out_of_plane=out_of_plane,
            springs=stretched,
        )

    def _out_of_plane_string(self, k: Kinematics, y: State, signs: Signs) -> _OutOfPlaneString:
        """Return directions and speed of a string whose light side unrolls to the hypotenuse S of P, in the plane, and z."""
        xp, p, effects = self.xp, self.p, self.effects
        whole, path = string_path(xp, y, signs.overlap, p, effects), winding(y, signs.overlap, p, effects).path
        c, s, u, v = path / whole, y.sideways / whole, y.retreat_speed, y.sideways_speed
        speed = c * u + s * v
        return _OutOfPlaneString(c, s, speed, (u * u + v * v - speed * speed) / whole, -air_drag_coefficient(xp, k, p) * v)

    def _heavy_rate(self, mode: Mode, signs: Signs, b: _ForceBalance) -> Any:
        """Return the upward acceleration u2' of the heavy mass [m/s^2]."""
        p = self.p
        if b.springs is not None and mode in (Mode.SLIDING_DOWN, Mode.SLIDING_UP, Mode.STICKING):
            return (b.springs.heavy_tension + b.force_on_heavy) / b.heavy_mass
        if mode.sliding:
            return _sliding_drive(b) / (b.heavy_mass + b.light_mass * b.sliding_ratio)
        if mode is Mode.ROLLING:
            mobility = p.rod_mobility
            driven = b.light_pull + b.force_on_heavy - p.bearing_friction * signs.rod
            return mobility * driven / (1.0 + mobility * (b.light_mass + b.heavy_mass))
        return b.force_on_heavy / b.heavy_mass if mode in (Mode.SLACK, Mode.FALLING) else 0.0

    def _rod_rate(self, mode: Mode, signs: Signs, b: _ForceBalance, heavy_rate: Any) -> Any:
        """Return the acceleration of the rod's surface [m/s^2]: R^2 / I (T1 - T2 - sign F0), 0 while its bearing holds it."""
        p = self.p
        if mode is Mode.ROLLING:
            return heavy_rate
        if not (mode.sliding or mode is Mode.SLACK):
            return 0.0
        light, heavy = _tensions(mode, b, heavy_rate)
        # The square is 0 while the bearing holds the rod, else 1: compiled expressions have no branches
        return signs.rod * signs.rod * p.rod_mobility * (light - heavy - p.bearing_friction * signs.rod)

    def rates(self, mode: Mode, t: Any, y: State, signs: Signs) -> State:
        """Return the derivatives of the state by time, with an entry for every variable, whether the mode moves it or not."""
        xp, p, effects = self.xp, self.p, self.effects
        b = self._force_balance(mode, t, y, signs)
        turning = y.across_speed / y.free_length
        heavy_rate = self._heavy_rate(mode, signs, b)
        u_rate = b.light_pull / b.light_mass if mode.slack else heavy_rate
        sideways_rate = 0.0
        if b.out_of_plane is not None:
            light_tension, _ = _tensions(mode, b, heavy_rate)
            u_rate = (b.in_plane_pull - b.out_of_plane.in_plane * light_tension) / b.along_mass
            sideways_rate = (b.out_of_plane.force - b.out_of_plane.along_rod * light_tension) / p.light_mass
        elif b.springs is not None:
            u_rate = (b.light_pull - _tensions(mode, b, heavy_rate)[0]) / b.along_mass
        light_stretching = heavy_stretching = 0.0
        if b.springs is not None:
            # Slack string passes to the light side as fast as the heavy mass rises, so that the heavy side's stretch stays
            passing_speed = y.heavy_speed if mode.slack else b.springs.passing_speed
            light_stretching, heavy_stretching = b.string_speed - passing_speed, passing_speed - y.heavy_speed
        across_rate = b.force_across / b.across_mass - y.retreat_speed * turning
        if self.pivot_holds and mode is Mode.CLAMPED:
            # The square is 0 while the pivot holds the light mass, else 1: compiled expressions have no branches
            across_rate = signs.across * signs.across * across_rate
        tilt_rate = swing_rate = 0.0
        # A clamp holds the heavy mass against swinging, too
        if self.heavy_mass_swings and mode not in (Mode.CLAMPED, Mode.CLAMPED_SLACK):
            tilt_rate, swing_rate = heavy_swing_rates(xp, b.k, p)
        return State(
            free_length=y.retreat_speed - winding(y, signs.overlap, p, effects).radius * turning,
            wrap_angle=turning,
            retreat_speed=u_rate,
            across_speed=across_rate,
            heavy_speed=heavy_rate,
            slack=y.heavy_speed - b.string_speed,
            heavy_tilt=tilt_rate,
            heavy_across_speed=swing_rate,
            sideways=y.sideways_speed,
            sideways_speed=sideways_rate,
            rod_speed=self._rod_rate(mode, signs, b, heavy_rate) if self.rod_turns else 0.0,
            light_stretch=light_stretching,
            heavy_stretch=heavy_stretching,
        )

    def tensions(self, mode: Mode, t: Any, y: State, signs: Signs) -> tuple[Any, Any]:
        """Return the tensions (T1, T2) in the free string and above the heavy mass [N]; a clamped mass counts as hanging."""
        b = self._force_balance(mode, t, y, signs)
        return _tensions(mode, b, self._heavy_rate(mode, signs, b))

    def holding_margins(self, mode: Mode, t: Any, y: State, signs: Signs) -> tuple[Any, Any]:
        """Return by how much the tensions are inside the friction cone of a string at rest on the rod, (down, up) [N].

        The rod holds the string while T1 / H <= T2 <= T1 H, with H the largest tension ratio that it can hold; below 0 the
        string slides. ``mode`` is STICKING, or ROLLING on a rod that turns.
        """
        b = self._force_balance(mode, t, y, signs)
        return self._margins(mode, signs, b)

    def _margins(self, mode: Mode, signs: Signs, b: _ForceBalance) -> tuple[Any, Any]:
        light, heavy = _tensions(mode, b, self._heavy_rate(mode, signs, b))
        tolerance = FRICTION_CONE_TOLERANCE * heavy
        return light * b.max_holding_ratio - heavy + tolerance, heavy * b.max_holding_ratio - light + tolerance

    def event_functions(self, mode: Mode, t: Any, y: State, signs: Signs) -> dict[Event, Any]:
        """Return the functions of the events that can end ``mode``; an event happens where its function falls through zero."""
        xp, p, effects = self.xp, self.p, self.effects
        length = y.free_length
        functions = {Event.LIGHT_REACHES_ROD: length - p.end_length, Event.ACROSS_REVERSES: signs.across * y.across_speed}
        if mode is Mode.FALLING:
            return functions
        b = self._force_balance(mode, t, y, signs)
        hanging_length = p.string_length - string_path(xp, y, signs.overlap, p, effects) - y.slack
        functions[Event.UNWRAPPED] = y.wrap_angle
        if any(effect.watches_first_turn for effect in effects):
            # The sign makes it fall through zero from either side of the full turn
            functions[Event.FIRST_TURN] = (2.0 * signs.overlap - 1.0) * (y.wrap_angle - TURN)
        # In the other modes the heavy mass rests
        if mode.string_moves or mode is Mode.SLACK:
            functions[Event.HEAVY_REACHES_ROD] = hanging_length
        if mode.sliding:
            returning, drive = signs.slide * y.heavy_speed, signs.slide * _sliding_drive(b)
            if self.rod_turns:
                heavy_rate = self._heavy_rate(mode, signs, b)
                light, heavy = _tensions(mode, b, heavy_rate)
                returning = signs.slide * (y.heavy_speed - y.rod_speed)
                bearing_margin = p.bearing_friction - signs.slide * (light - heavy)
                rod_rate = self._rod_rate(mode, signs, b, heavy_rate)
                drive = signs.slide * (heavy_rate - rod_rate)
                # One function for both: the return to rest of a rod that turns, and the bearing's margin of one that rests
                functions[Event.ROD_CHANGES] = _rod_returns(signs, y, rod_rate) + (1.0 - signs.rod * signs.rod) * bearing_margin
            if b.springs is not None:
                functions[Event.STOP] = signs.slide * b.springs.passing_speed + PASSING_SPEED_OFFSET
                functions[Event.LOSES_TENSION] = b.springs.taut_margin
            else:
                functions[Event.STOP] = signs.phase * returning + (1.0 - signs.phase) * (drive + EVENT_FUNCTION_OFFSET)
                # Numerator of T1; its denominator, heavy_mass + light_mass T2/T1, is positive
                functions[Event.LOSES_TENSION] = b.heavy_mass * b.light_pull - b.light_mass * b.force_on_heavy
        elif mode in (Mode.STICKING, Mode.ROLLING):
            functions[Event.SLIP_ONSET_DOWN], functions[Event.SLIP_ONSET_UP] = self._margins(mode, signs, b)
            if mode is Mode.ROLLING:
                functions[Event.ROD_STOPS] = _rod_returns(signs, y, self._heavy_rate(mode, signs, b))
            elif self.rod_turns:
                # While the rod rests, T1 - T2 = light_pull + force_on_heavy
                functions[Event.ROD_YIELDS_UP] = p.bearing_friction - (b.light_pull + b.force_on_heavy)
                functions[Event.ROD_YIELDS_DOWN] = p.bearing_friction + (b.light_pull + b.force_on_heavy)
        elif mode is Mode.CLAMPED:
            functions[Event.LOSES_TENSION] = b.light_pull if b.springs is None else b.springs.light_tension
            if self.pivot_holds:
                # One function for both: the turning point, and the margin of the pivot that holds the light mass at rest
                limit = p.pivot_friction / length
                margin = limit * limit - b.force_across * b.force_across
                functions[Event.ACROSS_REVERSES] = signs.across * y.across_speed + (1.0 - signs.across * signs.across) * margin
        else:
            slack, closing = y.slack, y.heavy_speed - b.string_speed + EVENT_FUNCTION_OFFSET
            if b.springs is not None:
                slack = -b.springs.taut_margin
                # The rate of this slack, which contains the rate of the stretch, too
                closing = closing + p.string_loss_time * (self._heavy_rate(mode, signs, b) - b.light_pull / b.light_mass)
            functions[Event.TAUT] = signs.phase * slack + (1.0 - signs.phase) * closing
            if mode is Mode.SLACK:
                functions[Event.HEAVY_REVERSES] = signs.heavy * y.heavy_speed
                if self.rod_turns:
                    # 1 for a rod at rest, so that it never falls: a slack string does not set the rod in motion
                    functions[Event.ROD_CHANGES] = signs.rod * y.rod_speed + (1.0 - signs.rod * signs.rod)
        return functions

    def impact(self, slide: float, t: Any, y: State, signs: Signs) -> Impact:
        """Return the result of an inelastic impulse along the string, which slides up (``slide`` +1), down (-1) or not (0).

        The impulses on the two sides obey the capstan law, too, J2 = J1 E with E = exp(-slide X), so that
        u = (M2 u2 + E M1 u1) / (M2 + E M1). A rod that can turn takes up J1 - J2; a fixed rod stops a string that does not
        slide.
        """
        xp, p, effects = self.xp, self.p, self.effects
        # Only inertias, speeds and geometry of it are read; in this mode they need no tension ratio
        b = self._force_balance(Mode.SLACK, t, y, signs)
        ratio = xp.exp(-slide * forces.sliding_exponent(xp, b.k, p, effects))
        light_string_speed = b.string_speed
        if slide:
            momentum = b.heavy_mass * y.heavy_speed + ratio * b.light_mass * light_string_speed
            speed = momentum / (b.heavy_mass + ratio * b.light_mass)
        elif self.rod_turns:
            momentum = b.heavy_mass * y.heavy_speed + b.light_mass * light_string_speed + y.rod_speed / p.rod_mobility
            speed = momentum / (b.heavy_mass + b.light_mass + 1.0 / p.rod_mobility)
        else:
            speed = 0.0
        impulse = b.light_mass * (light_string_speed - speed)
        after = y._replace(retreat_speed=speed, heavy_speed=speed, slack=0.0)
        if b.out_of_plane is not None:
            after = after._replace(
                retreat_speed=y.retreat_speed - b.out_of_plane.in_plane * impulse / b.along_mass,
                sideways_speed=y.sideways_speed - b.out_of_plane.along_rod * impulse / p.light_mass,
            )
        if self.rod_turns:
            rod_speed = y.rod_speed + p.rod_mobility * impulse * (1.0 - ratio) if slide else speed
            after = after._replace(rod_speed=rod_speed)
        return Impact(after, speed - after.rod_speed)

    def with_stretch_at_rest(self, t: Any, y: State, signs: Signs) -> State:
        """Return ``y`` with the stretch of a string at rest on the verge of sliding down.

        T2 is the weight of the heavy mass and T1 = T2 / E.
        """
        xp, p, effects = self.xp, self.p, self.effects
        b = self._force_balance(Mode.SLIDING_DOWN, t, y, signs)
        share = _light_share(string_path(xp, y, signs.overlap, p, effects), 0.0, p)
        weight, c = -b.force_on_heavy, p.string_compliance
        return y._replace(light_stretch=weight / b.sliding_ratio * c * share, heavy_stretch=weight * c * (1.0 - share))

    def with_even_stretch(self, y: State, signs: Signs) -> State:
        """Return ``y`` with its stretch spread evenly over the string, as it spreads in a string without tension."""
        xp, p, effects = self.xp, self.p, self.effects
        whole = y.light_stretch + y.heavy_stretch
        share = _light_share(string_path(xp, y, signs.overlap, p, effects), y.light_stretch, p)
        return y._replace(light_stretch=whole * share, heavy_stretch=whole * (1.0 - share))


def _light_share(path: Any, light_stretch: Any, p: SimpleNamespace) -> Any:
    """Return the share of the string's rest length that is on the light side; ``path``: length of that side [m]."""
    return (path - light_stretch) / p.string_length


def _springs(mode: Mode, y: State, string_speed: Any, path: Any, ratio: Any, p: SimpleNamespace) -> _Springs:
    """Return tensions and passing speed of a string that stretches: a spring and damper on either side of the rod.

    With e the stretch of a side, S' the speed at which the path on the light side grows, u2 the upward speed of the heavy mass,
    and q the length of string that has passed to the light side::

        T1 = k1 (e1 + tau e1'),  e1' = S' - q'        T2 = k2 (e2 + tau e2'),  e2' = q' - u2

    The stiffness of a side is k = 1 / (C share), with its share of the string's length and the compliance C of the whole
    string. While the string slides, q' is the speed that keeps the tensions on the edge of the friction cone, T2 = E T1, an
    equation that is linear in q'; while the rod holds the string, q' = 0.

    Parameters
    ----------
    string_speed
        Speed S' at which the path on the light side grows [m/s].
    path
        Length of string from the top of the rod to the light mass [m].
    ratio
        E = T2 / T1 while the string slides; not read in other modes.
    """
    tau, share = p.string_loss_time, _light_share(path, y.light_stretch, p)
    light_stiffness, heavy_stiffness = 1.0 / (p.string_compliance * share), 1.0 / (p.string_compliance * (1.0 - share))
    # e + tau e' on either side if no string passed
    held_light, held_heavy = y.light_stretch + tau * string_speed, y.heavy_stretch - tau * y.heavy_speed
    passing_speed: Any = 0.0
    if mode.sliding:
        passing_speed = (ratio * light_stiffness * held_light - heavy_stiffness * held_heavy) / (
            tau * (heavy_stiffness + ratio * light_stiffness)
        )
    return _Springs(
        light_tension=light_stiffness * (held_light - tau * passing_speed),
        heavy_tension=heavy_stiffness * (held_heavy + tau * passing_speed),
        passing_speed=passing_speed,
        taut_margin=held_light + held_heavy,
    )

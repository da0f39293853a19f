"""The settings of the live model for an apparatus, as its JavaScript takes them."""

from __future__ import annotations

from looping_pendulum.errors import ParameterError
from looping_pendulum.live.symbols import live_coefficients, live_effects
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters


def absent_effects(parameters: Parameters) -> tuple[str, ...]:
    """Return the names of the effects that act on the apparatus and that the live model does not have."""
    known = {effect.name for effect in live_effects(parameters.release)}
    return tuple(effect.name for effect in parameters.effects if effect.name not in known)


def live_settings(parameters: Parameters) -> dict[str, float | str]:
    """Return the settings [SI] by name, for ``loopingPendulum.simulate``.

    Raises
    ------
    ParameterError
        If an effect acts that the live model does not have.
    """
    absent = absent_effects(parameters)
    if absent:
        known = ", ".join(sorted(effect.name for effect in live_effects(parameters.release)))
        raise ParameterError(f"effects: found {absent[0]}, which the live model does not have; it has {known}")
    return settings_without_absent_effects(parameters)


def settings_without_absent_effects(parameters: Parameters) -> dict[str, float | str]:
    """Return the settings of the live model that is nearest to an apparatus: the same, without `absent_effects`."""
    numbers = {name: float(getattr(parameters, name)) for name in NUMBERS}
    coefficients = {name: parameters.coefficients[name] for name in live_coefficients()}
    return {"release": parameters.release.value, **numbers, **coefficients}

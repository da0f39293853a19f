"""The settings of the live model for an apparatus, as its JavaScript takes them."""

from __future__ import annotations

from looping_pendulum.errors import ParameterError
from looping_pendulum.live.symbols import live_coefficients, live_effects
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters


def live_settings(parameters: Parameters) -> dict[str, float | str]:
    """Return the settings [SI] by name, for ``loopingPendulum.simulate``.

    Raises
    ------
    ParameterError
        If an effect acts that the live model does not have.
    """
    known = {effect.name for effect in live_effects(parameters.release)}
    absent = [effect.name for effect in parameters.effects if effect.name not in known]
    if absent:
        raise ParameterError(
            f"effects: found {absent[0]}, which the live model does not have; it has {', '.join(sorted(known))}"
        )
    numbers = {name: float(getattr(parameters, name)) for name in NUMBERS}
    coefficients = {name: parameters.coefficients[name] for name in live_coefficients()}
    return {"release": parameters.release.value, **numbers, **coefficients}

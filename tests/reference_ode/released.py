"""A run just after its release, as the rules make it in floats."""

from looping_pendulum.reference_ode import rules


class Released:
    """What the rules read of a run, and where it stands."""

    def __init__(self, parameters):
        self.parameters, self.values, self.effects = parameters, parameters.values(), parameters.effects
        self.system = rules.system_of_floats(self.values, self.effects)
        self.motion = rules.release(self.system, parameters.release, rules.state_at_release(parameters))

    def leave_rest(self):
        """Leave rest; return the terms of the series by which it did, or None."""
        self.motion, series, by_series = rules.leave_rest(self.system, rules.enter(self.system, self.motion))
        return series if by_series else None

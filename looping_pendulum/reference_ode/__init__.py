"""The exact hybrid model of the looping pendulum."""

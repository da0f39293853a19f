"""The exact model of the looping pendulum: differential equations in several modes, with events between them."""

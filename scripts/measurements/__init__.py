"""Measurements behind the documentation's numbers; see `scripts.measure`."""

"""Fit a model to all trials together, and look at what it leaves."""

"""Blind test data: a simulator and a camera that share no equation with the package."""

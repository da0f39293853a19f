"""Fit a model to all trials together, and test the residuals."""

"""Ladders of ever finer runs, and a verdict on each: converged, not converged, another limit than the reference."""

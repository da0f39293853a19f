"""Ladders of ever finer runs, and every error split: not converged, different model, adapter's choice."""

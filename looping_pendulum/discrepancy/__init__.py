"""Compare the model with measured data: read them, fit the model, find what it lacks, and report how certain that is."""

"""Close the loop with measured data: read it, fit the model, name what the model lacks, and say how sure that is."""

"""Effects of the library as candidates: screen them by the residuals of a fit, refit the best, test those on held-out data."""

"""Search for the coefficients of a motion."""

"""Scores on motions that were not fitted."""

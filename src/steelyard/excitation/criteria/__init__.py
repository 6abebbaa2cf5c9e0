"""Criteria of how well a motion shows the parameters."""

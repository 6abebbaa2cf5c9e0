"""Readings of a log, and how well each agrees with the dynamics."""

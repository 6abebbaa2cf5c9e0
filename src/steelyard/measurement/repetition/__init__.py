"""Means over repetitions of one motion."""

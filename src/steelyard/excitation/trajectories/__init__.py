"""Motions whose extremes over all times are known."""

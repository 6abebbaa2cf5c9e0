"""Checks of the log alone."""

"""Checks that compare interpretations of a log."""

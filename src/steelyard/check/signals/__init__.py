"""Checks of logs that need no model."""

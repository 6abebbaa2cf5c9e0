"""Quantities of a robot as compiled functions."""

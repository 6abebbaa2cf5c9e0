"""Causes of torque: one law a file."""

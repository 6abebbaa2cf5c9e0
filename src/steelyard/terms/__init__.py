"""Causes of torque, each linear in its named parameters."""

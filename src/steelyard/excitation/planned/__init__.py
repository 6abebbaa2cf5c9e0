"""Motions that are planned and not searched."""

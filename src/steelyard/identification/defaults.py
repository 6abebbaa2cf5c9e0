"""Defaults that commands and functions share; imports nothing, so that `--help` stays quick."""

DESIGN_BUDGET_S = 10.0
"""Time limit of the search for an excitation motion, if none is given [s]."""

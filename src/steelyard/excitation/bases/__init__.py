"""Families of motions that are linear in their coefficients."""

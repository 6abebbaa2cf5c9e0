"""Nonlinear parameters of terms, found by search over passes through the data."""

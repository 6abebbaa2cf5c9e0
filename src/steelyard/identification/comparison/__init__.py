"""Estimators, or models, side by side on the same logs."""

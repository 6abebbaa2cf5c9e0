"""Estimators that need only sums of products."""

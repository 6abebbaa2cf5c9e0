"""Estimators that look at single samples."""

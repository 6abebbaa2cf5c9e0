"""Estimators and models side by side."""

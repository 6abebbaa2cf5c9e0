"""Estimators: from information to parameters with intervals."""

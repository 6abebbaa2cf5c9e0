"""Regressor, base parameters, and the information of all samples."""

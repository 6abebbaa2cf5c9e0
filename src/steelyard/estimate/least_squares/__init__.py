"""Ordinary and weighted least squares, and their covariance."""

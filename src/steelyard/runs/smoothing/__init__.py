"""Smoothing and differentiation of positions."""

"""Sections about how well logs determine a model."""

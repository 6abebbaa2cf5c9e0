"""Drift of friction, offsets and effort scales."""

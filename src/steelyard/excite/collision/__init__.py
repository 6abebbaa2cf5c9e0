"""Collision geometry, distances, and clearance along a motion."""

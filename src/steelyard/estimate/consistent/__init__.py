"""Physically consistent inertial parameters."""

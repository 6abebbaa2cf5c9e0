"""Readers of model files: URDF, MJCF, xacro, Denavit-Hartenberg tables."""

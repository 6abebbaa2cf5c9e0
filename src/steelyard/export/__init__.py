"""Identified models as files: URDF, MJCF, and code for controllers."""

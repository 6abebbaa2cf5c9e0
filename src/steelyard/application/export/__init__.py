"""Identified models as URDF and MJCF."""

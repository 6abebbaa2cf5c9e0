"""Models as URDF and MJCF."""

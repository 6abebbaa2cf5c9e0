"""Trajectories whose extremes over all times are known exactly."""

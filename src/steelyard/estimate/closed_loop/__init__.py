"""Estimators that simulate the robot under a controller."""

"""Estimators that simulate the robot under its controller."""

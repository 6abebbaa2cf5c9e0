"""Motions in the formats of controllers, simulators and ROS."""

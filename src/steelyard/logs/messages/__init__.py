"""Logs of messages: MCAP and ROS bags."""

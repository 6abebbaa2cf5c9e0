"""Actuators of an arm that follows position targets: identified from targets and positions."""

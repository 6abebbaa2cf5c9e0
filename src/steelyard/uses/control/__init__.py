"""Joint controllers, and torques of a model along a motion."""

"""Joint controllers with and without an identified model, and torques along a motion."""

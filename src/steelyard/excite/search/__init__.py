"""Search for the best motion."""

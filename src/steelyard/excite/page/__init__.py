"""The pages about a designed motion."""

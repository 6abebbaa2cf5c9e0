"""Smaller models, and the loop with motion designed for them."""

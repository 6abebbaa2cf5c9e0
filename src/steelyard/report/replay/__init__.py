"""Motions replayed in a browser."""

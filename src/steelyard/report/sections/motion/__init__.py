"""Sections about a designed motion."""

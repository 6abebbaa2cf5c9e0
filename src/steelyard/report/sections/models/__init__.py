"""Sections about several identified models side by side."""

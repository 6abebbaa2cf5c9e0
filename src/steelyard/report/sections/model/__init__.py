"""Sections about an identified model."""

"""Sections of the report about an identified model."""

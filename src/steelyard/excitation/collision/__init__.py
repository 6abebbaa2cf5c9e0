"""Clearances between links, tools and the cell."""

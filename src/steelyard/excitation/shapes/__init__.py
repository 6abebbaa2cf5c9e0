"""Shapes of links, tools and cells, and their distances."""

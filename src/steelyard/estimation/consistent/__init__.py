"""Physically consistent estimates."""

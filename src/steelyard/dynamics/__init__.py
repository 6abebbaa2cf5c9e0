"""Efforts and other quantities of a model: as programs, along motions, and at single samples."""

"""Errors, arrays, parameters, motion, files, progress: what every room needs."""

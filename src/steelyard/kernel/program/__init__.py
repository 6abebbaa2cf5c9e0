"""Equations traced to straight-line programs, and what is done with programs."""

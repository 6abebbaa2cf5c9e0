"""Motions of robots that stand: legs that follow the base, forces of the feet, information."""

"""Models with fewer parameters: criteria, elimination, stopping rules."""

"""External wrench along a run: external efforts, estimate, directions that are not seen."""

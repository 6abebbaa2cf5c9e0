"""Errors on motion that was not fitted, bands, comparisons."""

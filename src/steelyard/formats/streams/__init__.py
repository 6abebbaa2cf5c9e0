"""Logs that are still being written: rows as they arrive."""

"""A log file to a table: readers, writers, windows, listings."""

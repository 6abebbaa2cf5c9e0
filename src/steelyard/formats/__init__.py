"""Log files of all kinds, read in parts."""

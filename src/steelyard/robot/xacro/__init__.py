"""Xacro files, expanded in this process."""

"""Checks of logs before an identification, and the corrections that they propose."""

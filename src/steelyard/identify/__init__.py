"""Identify, validate, compare, reduce: functions with results."""

"""Payloads, and when they change."""

"""Sections about a motion run under several controllers."""

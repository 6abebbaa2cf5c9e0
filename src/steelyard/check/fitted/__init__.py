"""Checks after the fit."""

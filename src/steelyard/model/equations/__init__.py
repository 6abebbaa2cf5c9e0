"""Rigid-body dynamics and closed chains, and functions compiled from them."""

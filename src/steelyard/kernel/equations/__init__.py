"""Equations of rigid-body dynamics over scalars of any kind."""

"""The choice of friction laws by left-out motion."""

"""Uses of an identified model."""

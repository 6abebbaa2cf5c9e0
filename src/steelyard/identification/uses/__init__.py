"""Uses of an identified model: feedforward, payload, contact, wrench, streams, health."""

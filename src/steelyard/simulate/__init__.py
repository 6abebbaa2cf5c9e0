"""A simulated robot with known parameters, its sensors and faults."""

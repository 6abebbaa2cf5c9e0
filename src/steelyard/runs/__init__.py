"""A log to a run: positions, velocities, accelerations and efforts on a uniform grid."""

"""Trajectories without search: moves, poses, task motions, sweeps."""

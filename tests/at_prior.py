"""Unknowns of the consistent estimate at the prior of every body."""

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import ONE, Unknowns


def at_prior(unknowns: Unknowns) -> Array:
    """`X = 1` of every body, no friction."""
    bodies = np.tile(ONE, len(unknowns.priors))
    return np.concatenate([bodies, np.zeros(len(unknowns.weak) - len(bodies))])

r"""Forward dynamics over symbols: accelerations of a mechanism under efforts.

Efforts are linear in the accelerations, $\tau = M(q)\,\ddot q + h(q, \dot q)$, so the mass matrix
is their derivative and the rest is what is left at $\ddot q = 0$.
"""

from collections.abc import Callable

from steelyard.model.equations.inverse_dynamics import Scalar, Scalars, solved_by_factors

Efforts = Callable[[Scalars], Scalars]  # accelerations to efforts


def accelerations(efforts: Efforts, applied: Scalars) -> tuple[list[Scalar], list[Scalar]]:
    """Accelerations under applied efforts, by $M = L D L^T$, and the pivots `D`.

    The pivots are positive if and only if the mass matrix is positive definite.
    """
    from steelyard.symbolic.symbols_and_tracing import affine

    mass, bias = affine(efforts, len(applied))
    sides = [tau - rest for tau, rest in zip(applied, bias, strict=True)]
    (found,), pivots = solved_by_factors(mass, [sides])
    return found, pivots

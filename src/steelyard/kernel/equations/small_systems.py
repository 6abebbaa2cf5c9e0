r"""Small linear systems over scalars of any kind: numbers, arrays and symbols alike.

Up to three equations are solved by cofactors, more by $L D L^T$ of their normal equations: neither
divides by a pivot that could vanish where the system itself is regular.
"""

from collections.abc import Sequence

from steelyard.kernel.equations.dynamics import Scalar

COFACTORS = 3
"""Largest system that is solved by cofactors."""


def solved(matrix: list[list[Scalar]], sides: Sequence[list[Scalar]]) -> list[list[Scalar]]:
    """Solutions of a square system, one per right-hand side.

    Args:
        matrix: Rows.
        sides: Right-hand sides.
    """
    if len(matrix) > COFACTORS:
        return _by_normal_equations(matrix, sides)
    size = range(len(matrix))
    adjugate = [[_cofactor(matrix, row, column) for row in size] for column in size]
    inverse = 1.0 / along(matrix[0], [adjugate[k][0] for k in size])
    return [[inverse * along(adjugate[k], side) for k in size] for side in sides]


def _cofactor(matrix: Sequence[Sequence[Scalar]], row: int, column: int) -> Scalar:
    rest = [
        [x for k, x in enumerate(line) if k != column] for j, line in enumerate(matrix) if j != row
    ]
    value = _determinant(rest)
    return value if (row + column) % 2 == 0 else negative(value)


def _determinant(matrix: Sequence[Sequence[Scalar]]) -> Scalar:
    if not matrix:
        return 1.0
    return along(matrix[0], [_cofactor(matrix, 0, k) for k in range(len(matrix))])


def _by_normal_equations(
    matrix: list[list[Scalar]], sides: Sequence[list[Scalar]]
) -> list[list[Scalar]]:
    size = len(matrix)
    columns = [[matrix[r][c] for r in range(size)] for c in range(size)]
    lower, diagonal = _factors([[along(a, b) for b in columns] for a in columns])
    solutions = []
    for side in sides:
        x = [along(column, side) for column in columns]
        for i in range(size):
            for k in range(i):
                x[i] = x[i] - lower[i][k] * x[k]
        x = [value / d for value, d in zip(x, diagonal, strict=True)]
        for i in reversed(range(size)):
            for k in range(i + 1, size):
                x[i] = x[i] - lower[k][i] * x[k]
        solutions.append(x)
    return solutions


def _factors(normal: Sequence[Sequence[Scalar]]) -> tuple[list[list[Scalar]], list[Scalar]]:
    r"""$L$ and $D$ of a positive definite matrix $L D L^T$."""
    size = len(normal)
    lower: list[list[Scalar]] = [[0.0] * size for _ in range(size)]
    diagonal: list[Scalar] = []
    for i in range(size):
        for j in range(i + 1):
            value = normal[i][j]
            for k in range(j):
                value = value - lower[i][k] * diagonal[k] * lower[j][k]
            if i == j:
                diagonal.append(value)
            else:
                lower[i][j] = value / diagonal[j]
    return lower, diagonal


def along(row: Sequence[Scalar], values: Sequence[Scalar]) -> Scalar:
    """Sum of products, leaving out what is zero by structure."""
    total: Scalar = None
    for factor, value in zip(row, values, strict=True):
        if factor is not None:
            total = factor * value if total is None else total + factor * value
    return 0.0 if total is None else total


def negative(scalar: Scalar) -> Scalar:
    """The scalar with its sign changed."""
    return -1.0 * scalar

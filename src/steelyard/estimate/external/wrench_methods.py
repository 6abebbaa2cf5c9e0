r"""The wrench that makes external efforts: what a method is, by weights or the inverse Jacobian.

A wrench $F$ on a frame makes efforts $\tau = J^T F$. With the covariance $S$ of what the model
predicts wrongly, and wrenches of the expected size $P$,

$$\hat F = (J S^{-1} J^T + P^{-1})^{-1} J S^{-1} \tau = P J (J^T P J + S)^{-1} \tau$$

with the covariance $P - P J (J^T P J + S)^{-1} J^T P$. The second form needs no inverse of $J$: it
is finite in singular postures, for any number of joints. What no effort shows stays at zero, with
an interval as wide as the expected size. $J^{-T} \tau$ knows neither $S$ nor $P$.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError

FORCE = 30.0  # expected size of a force [N]: a firm push
LEVER = 0.1  # expected distance of a force from the frame's origin [m]
FORCES, LEVERS = (0.1, 1e5), (0.0, 100.0)  # range of expected forces [N] and levers [m]
TINY = 1e-12  # singular values of a Jacobian below this share of the largest are zero


@dataclass(frozen=True)
class Expected:
    """The size that wrenches are expected to have."""

    force: float = FORCE  # standard deviation of each component of the force [N]
    # that of each component of the moment, over `force` [m]; 0 for forces at the origin
    lever: float = LEVER

    def __post_init__(self) -> None:
        for name, value, (least, most), unit, usual in (
            ("force", self.force, FORCES, "N", "the size of a usual force, such as 30 N"),
            ("lever", self.lever, LEVERS, "m", "how far from the frame's origin, such as 0.1 m"),
        ):
            if not least <= value <= most:
                raise DataError(
                    f"a {name} of {value:g} {unit} is no expected size: {least:g} to {most:g} "
                    f"{unit} can be expected",
                    where=f"expected wrench (--{name})",
                    fix=f"give {usual}",
                )

    @property
    def variances(self) -> Array:
        """Diagonal of $P$, shape `(6,)`."""
        return frozen(np.repeat(np.square([self.force, self.force * self.lever]), 3))


@dataclass(frozen=True, eq=False)
class ExternalEfforts:
    """External efforts along a stretch of a log, behind a low-pass, and how far they may be off.

    They are $J^T F + A z + e$ with parameters $z$ of the model, independent and of variance 1, and
    residuals $e$, one part of which is slow, another one noise.
    """

    step: float  # time between samples [s]
    torque: Array  # external efforts, `(N, n)` [Nm; N]
    jacobian: Array  # of the frame, `(N, 6, n)`
    spread: Array  # $A$, `(N, n, k)`
    slow: Array  # standard deviation of the slow residuals, `(N, n)` [Nm; N]
    noise: Array  # that of the others, likewise
    correlation: Array  # of both between joints, `(n, n)`
    per_independent: float  # samples per independent one of the noise

    def part(self, at: slice) -> "ExternalEfforts":
        """Some consecutive samples."""
        names = ("torque", "jacobian", "spread", "slow", "noise")
        return replace(self, **{name: getattr(self, name)[at] for name in names})

    @property
    def covariance(self) -> Array:
        """$S$, shape `(N, n, n)`."""
        std = np.hypot(self.slow, self.noise)
        residual = std[:, :, None] * self.correlation * std[:, None, :]
        return np.asarray(self.spread @ self.spread.swapaxes(1, 2) + residual)


@dataclass(frozen=True, eq=False)
class Wrenches:
    """Estimated wrenches."""

    values: Array  # force [N] and moment [Nm], `(N, 6)`
    covariance: Array  # `(N, 6, 6)`
    # share of what is expected of a wrench that efforts decide, see `learned_of`, `(N, 6, 6)`
    learned: Array


class WrenchMethod(Protocol):
    """From external efforts to wrenches."""

    name: ClassVar[str]

    @property
    def expected(self) -> Expected:
        """The size of wrenches, beside which a direction is seen or not."""

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """Wrenches of all samples."""


@dataclass(frozen=True)
class Weighted:
    """Each sample by itself, weighted by the model's uncertainty and the expected size."""

    name: ClassVar[str] = "weighted"
    expected: Expected = Expected()  # the size

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """See `WrenchMethod`."""
        prior, jacobian = self.expected.variances, efforts.jacobian
        spread = jacobian * prior[:, None]
        together = jacobian.swapaxes(1, 2) @ spread + efforts.covariance
        gain = np.linalg.solve(together, spread.swapaxes(1, 2)).swapaxes(1, 2)
        covariance = np.diag(prior) - gain @ spread.swapaxes(1, 2)
        values = (gain @ efforts.torque[:, :, None])[:, :, 0]
        return Wrenches(values, covariance, learned_of(covariance, self.expected))


@dataclass(frozen=True)
class InverseJacobian:
    r"""$J^{-T} \tau$, by the pseudo-inverse where $J$ has none; large near singular postures."""

    name: ClassVar[str] = "inverse"
    expected: Expected = Expected()  # the size of wrenches, beside which a direction is seen or not

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """See `WrenchMethod`."""
        inverse = np.linalg.pinv(efforts.jacobian.swapaxes(1, 2), rcond=TINY)
        values = (inverse @ efforts.torque[:, :, None])[:, :, 0]
        covariance = inverse @ efforts.covariance @ inverse.swapaxes(1, 2)
        return Wrenches(values, covariance, Weighted(self.expected)(efforts).learned)


def learned_of(covariance: Array, expected: Expected) -> Array:
    r"""Share of what is expected of a wrench that efforts decide, $1 - P^{-1/2} C P^{-1/2}$.

    $C$ is a covariance, and $P$ what it was before, shape `(N, 6, 6)`. Eigenvalues of 0 belong to
    directions that no effort shows, of 1 to those that efforts show exactly. Without a lever there
    is nothing to know of moments.
    """
    std = np.sqrt(expected.variances)
    scale = np.divide(1.0, std, out=np.zeros(6), where=std > 0.0)
    return np.asarray(np.eye(6) - scale[:, None] * covariance * scale)


def condition_numbers(jacobian: Array) -> Array:
    """Condition number of each Jacobian, `(N, 6, n)` to `(N,)`; infinite where it is singular."""
    values = np.linalg.svd(jacobian, compute_uv=False)
    if jacobian.shape[2] < jacobian.shape[1]:
        return np.full(len(jacobian), np.inf)
    with np.errstate(divide="ignore"):
        return np.asarray(values[:, 0] / values[:, -1])

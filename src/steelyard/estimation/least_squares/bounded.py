r"""Least squares within bounds of the base parameters, from information alone.

$\min \|R\varphi - z\|$ subject to $l \le \varphi \le u$, weighted as weighted least squares is;
solved by an active set [Stark1995], so the optimum is exact.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.box import Box
from steelyard.estimation.least_squares.whitened import whitened
from steelyard.regression.information import Information


@dataclass(frozen=True)
class BoundedLeastSquares:
    """Weighted least squares within bounds.

    The intervals are those without the bounds: wider than need be where a bound holds.

    Attributes:
        bounds: Lower and upper bound by column, see `box.base_bounds`.
        per_run: Columns whose parameters every run has for itself.
    """

    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    per_run: tuple[str, ...] = ()

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see.

        Raises:
            DataError: The data show nothing, or a bound is unusable.
        """
        box = Box.of(whitened(information, self.per_run), self.bounds)
        return box.estimate("bounded least squares", box.optimum(), ())

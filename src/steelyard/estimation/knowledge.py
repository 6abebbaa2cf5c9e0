"""What is known of a robot's parameters before its data: priors of bodies, bounds, rows."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia


@dataclass(frozen=True)
class Row:
    r"""A linear constraint, $l \le \sum_k a_k \phi_k \le u$, over standard parameters.

    Attributes:
        label: What was wished and where, for messages.
        coefficients: $a_k$ by name of the parameter.
        lower: $l$; minus infinity for none.
        upper: $u$; infinity for none; equal to `lower` for an equation.
    """

    label: str
    coefficients: Mapping[str, float]
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known before the data.

    Attributes:
        names: Standard parameters of the model, `p` of them.
        bodies: Names of the bodies, in the model's order.
        priors: Per body the nominal mass properties, with a positive definite pseudo-inertia;
            `None` for a body without prior.
        lower: Lower bounds of the parameters, shape `(p,)`.
        upper: Upper bounds, shape `(p,)`.
        rows: Further constraints.
        curves: Rows that bound the friction along a coordinate as a whole.
        deviations: Standard deviations from zero that some parameters have, by name.
        shaped: Parameters in them whose own lower bounds these rows replace.
        uncertainty: Relative uncertainty of the priors; found from the data if `None`.
        notes: What was assumed, for people to read.
    """

    names: tuple[str, ...]
    bodies: tuple[str, ...]
    priors: tuple[Inertia | None, ...]
    lower: Array
    upper: Array
    rows: tuple[Row, ...] = ()
    curves: tuple[Row, ...] = ()
    shaped: frozenset[str] = frozenset()
    deviations: Mapping[str, float] = field(default_factory=dict)
    uncertainty: float | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            object.__setattr__(self, name, frozen(getattr(self, name), (len(self.names),)))
        if len(self.priors) != len(self.bodies):
            raise ValueError(f"{len(self.priors)} priors for {len(self.bodies)} bodies")

    def tens(self, body: int) -> list[int]:
        """Indices of a body's ten parameters among `names`."""
        place = {name: k for k, name in enumerate(self.names)}
        return [place[f"{kind}.{self.bodies[body]}"] for kind in INERTIAL_NAMES]

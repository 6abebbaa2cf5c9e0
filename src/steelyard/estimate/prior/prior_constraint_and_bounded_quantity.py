"""What prior constraints are made from: their place in a model and file, bounded quantities."""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import NoReturn

import numpy as np

from steelyard.base.errors import ModelError, advice
from steelyard.estimate.prior.body_priors import Row, body_index, rigid_bodies
from steelyard.model.model import Model


@dataclass(frozen=True, eq=False)
class ConstraintContext:
    """A model's parameters and a constraint's place; what is not there is a `ModelError`."""

    model: Model
    where: str

    def body(self, name: str) -> str:
        """The name, if a moving link with parameters has it."""
        body_index(self.model.robot, name, self.where)
        if not rigid_bodies(self.model):
            self.refuse(
                f"the model has no mass properties of link '{name}'",
                'add "rigid_body" to the terms, or remove the constraint',
            )
        return name

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all moving links."""
        return tuple(body.name for body in rigid_bodies(self.model).values())

    def parameters(self, pattern: str) -> tuple[str, ...]:
        """Parameters that a name means; `*` in it stands for anything."""
        found = tuple(n for n in self.model.names if n == pattern or fnmatchcase(n, pattern))
        if not found:
            fix = advice(pattern, self.model.names, "parameters")
            self.refuse(f"the model has no parameter '{pattern}'", fix)
        return found

    def parameter(self, name: str) -> str:
        """The name, if a parameter has it."""
        if name not in self.model.names:
            fix = advice(name, self.model.names, "parameters")
            self.refuse(f"the model has no parameter '{name}'", fix)
        return name

    def refuse(self, wrong: str, fix: str) -> NoReturn:
        """Refuse this constraint."""
        raise ModelError(wrong, where=self.where, fix=fix)

    def row(
        self, label: str, coefficients: Mapping[str, float], interval: "Interval | float"
    ) -> Row:
        """A row with the constraint in words, and its place in the file."""
        low, high = (interval, interval) if isinstance(interval, float) else interval
        return Row(f"{label} ({self.where})", coefficients, low, high)


Interval = tuple[float, float]  # lower and upper bound


@dataclass(frozen=True, kw_only=True)
class Bounded:
    """A quantity that is known, or lies between bounds.

    Attributes:
        lower: Least value; none if `None`.
        upper: Greatest value; none if `None`.
        value: The value itself, instead of bounds.
    """

    lower: float | None = None
    upper: float | None = None
    value: float | None = None

    def interval(self, scope: ConstraintContext) -> Interval:
        """Lower and upper bound, in this order; or one value, not beside bounds."""
        bounds = self.lower is not None or self.upper is not None
        if bounds == (self.value is not None):
            scope.refuse(
                "a value and bounds are given" if bounds else "neither value nor bounds are given",
                "give value = ..., or lower = ... and upper = ..., or one of these",
            )
        if self.value is not None:
            return self.value, self.value
        low = -np.inf if self.lower is None else self.lower
        high = np.inf if self.upper is None else self.upper
        if low > high:
            scope.refuse(
                f"the lower bound {low:g} is above the upper bound {high:g}", "exchange them"
            )
        return low, high


def in_words(interval: Interval, unit: str = "") -> str:
    """A bound as people say it: `at least 3 kg`, `between 3 and 5 kg`, `3 kg`."""
    low, high = interval
    if low == high:
        text = f"{low:g}"
    elif not np.isfinite(high):
        text = f"at least {low:g}"
    elif not np.isfinite(low):
        text = f"at most {high:g}"
    else:
        text = f"between {low:g} and {high:g}"
    return f"{text} {unit}".rstrip()

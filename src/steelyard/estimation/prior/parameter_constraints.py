"""What can be known of any parameter: its value, bounds, another one it depends on."""

from dataclasses import dataclass
from typing import ClassVar

from steelyard.estimation.knowledge import Row
from steelyard.estimation.prior.prior_constraint import Bounded, ConstraintContext, in_words


@dataclass(frozen=True, kw_only=True)
class Known(Bounded):
    """Parameters that are known, or lie between bounds.

    Attributes:
        parameter: Name; `*` stands for anything, so that `viscous.*` is that of every joint.
    """

    kind: ClassVar[str] = "parameter"
    parameter: str

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$l \le \phi \le u$ for each."""
        interval = self.interval(scope)
        units = dict(zip(scope.model.names, scope.model.units, strict=True))
        return [
            scope.row(f"'{name}' is {in_words(interval, units[name])}", {name: 1.0}, interval)
            for name in scope.parameters(self.parameter)
        ]


@dataclass(frozen=True, kw_only=True)
class Tied:
    """A parameter that is a multiple of another.

    Attributes:
        parameter: Its name.
        to: The other one.
        factor: How many times the other one it is.
    """

    kind: ClassVar[str] = "tied"
    parameter: str
    to: str
    factor: float = 1.0

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$\phi_1 - k\,\phi_2 = 0$."""
        one, other = scope.parameter(self.parameter), scope.parameter(self.to)
        if one == other:
            scope.refuse(f"'{one}' is tied to itself", "name another parameter under `to`")
        label = f"'{one}' is {self.factor:g} times '{other}'"
        return [scope.row(label, {one: 1.0, other: -self.factor}, 0.0)]

r"""How large efforts and powers may be, whatever sign friction has; as machine code.

Where a law takes the sign of a velocity, friction may act either way when the joint almost stands
still, so a sign counts as any number from -1 to 1 and the effort of joint `j` is bounded by

$$\tau_j^\pm = \tau_j(s = 0) + \sum_i \max_{s_i \in \{-1, 0, 1\}} \text{ or } \min \;
  [\tau_j(s_i) - \tau_j(0)].$$

Friction is a sum over its signs, each of which may be switched off at low speed; so the bounds
hold for all signs together. They are continuous in the motion, as the effort itself is not.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.model.equations.inverse_dynamics import Scalar, Scalars
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program
from steelyard.symbolic.symbols_and_tracing import in_time, replayed, slopes_of, symbolic

Efforts = Callable[..., Scalars]
"""Position, velocity, acceleration and parameters to the effort of every joint."""


@dataclass(frozen=True, eq=False)
class EffortBounds:
    """Greatest and least efforts or powers, `K` of each.

    Inputs of `code` and `values` are position, velocity, acceleration and shared parameters,
    outputs the greatest, then the least; of `code` also their derivatives by position, velocity and
    acceleration, one by one. `rates`, with the jerk before the parameters, is how fast the greatest
    and the least change in time.
    """

    code: Code
    values: Program
    rates: Program


def effort_bounds(
    key: Sequence[Any], smooth: Efforts, rough: Efforts | None, n: int, parameters: int, power: bool
) -> EffortBounds:
    """Programs for a robot of `n` joints.

    The efforts `smooth` have no sign in them, those of `rough` have; `key` is all that they depend
    on, as JSON. With `power` the power of every joint and of all together is bounded, not the
    effort.
    """

    def build() -> tuple[Program, dict[str, Any]]:
        state = [Input(name, n) for name in ("q", "dq", "ddq")]
        shared = Input("parameters", parameters, shared=True)
        law = None if rough is None else symbolic(rough, [*state, shared])

        def values(*x: Scalars) -> list[Scalar]:
            middle, most, least = _spread(smooth(*x), law, x)
            if power:
                return _powers(middle, most, least, x[1])
            return [a + b for part in (most, least) for a, b in zip(middle, part, strict=True)]

        def slopes(*x: Scalars) -> list[Scalar]:
            found = values(*x)
            return [*found, *slopes_of(found, [v for part in x[:3] for v in part])]

        def rates(*x: Scalars) -> list[Scalar]:
            return in_time(lambda *moving: values(*moving, x[4]), *x[:4])

        about = {
            "values": symbolic(values, [*state, shared]),
            "rates": symbolic(rates, [*state, Input("jerk", n), shared]),
        }
        return symbolic(slopes, [*state, shared]), about

    code = compiled(["effort bounds", power, *key], build)
    return EffortBounds(code, *code.beside("values", "rates"))


def _spread(
    efforts: Scalars, law: Program | None, x: Sequence[Scalars]
) -> tuple[list[Scalar], list[Scalar], list[Scalar]]:
    """Efforts without signs, and the most and the least that signs add to them."""
    n = len(efforts)
    if law is None:
        return list(efforts), [0.0] * n, [0.0] * n

    def at(signs: Sequence[float]) -> list[Scalar]:
        """Efforts of the law with these signs; comparisons hold."""
        given = iter(signs)
        instead: dict[str, Callable[..., Scalar]] = {
            "sign": lambda _: next(given),
            "less": lambda *_: 1.0,
            "less_equal": lambda *_: 1.0,
            "maximum": _larger,
            "minimum": lambda a, b: 0.5 * (a + b - np.abs(a - b)),
        }
        return replayed(law, x, instead)

    count = sum(step.operation == "sign" for step in law.steps)
    still = at([0.0] * count)
    most: list[Scalar] = [0.0] * n
    least: list[Scalar] = [0.0] * n
    for k in range(count):
        ways = [at([way if i == k else 0.0 for i in range(count)]) for way in (1.0, -1.0)]
        for j in range(n):
            # zero by structure where effort j does not depend on this sign
            one, other = (way[j] - still[j] for way in ways)
            most[j] = most[j] + _larger(_larger(one, other), 0.0)
            least[j] = least[j] - _larger(_larger(-one, -other), 0.0)
    return [a + b for a, b in zip(efforts, still, strict=True)], most, least


def _larger(a: Scalar, b: Scalar) -> Scalar:
    """The larger one; its derivative, unlike that of `maximum`, divides by nothing."""
    return 0.5 * (a + b + np.abs(a - b))


def _powers(middle: Scalars, most: Scalars, least: Scalars, dq: Scalars) -> list[Scalar]:
    """Greatest powers of the joints and of all together, then the least."""
    own = [(m + 0.5 * (a + b)) * v for m, a, b, v in zip(middle, most, least, dq, strict=True)]
    ways = [0.5 * (a - b) * np.abs(v) for a, b, v in zip(most, least, dq, strict=True)]
    own, ways = [*own, sum(own[1:], own[0])], [*ways, sum(ways[1:], ways[0])]
    return [
        *(a + b for a, b in zip(own, ways, strict=True)),
        *(a - b for a, b in zip(own, ways, strict=True)),
    ]

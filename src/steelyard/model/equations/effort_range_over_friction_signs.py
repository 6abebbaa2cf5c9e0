r"""How large efforts and powers may be, whatever sign friction has.

Where a law takes the sign of a velocity, friction may act either way when the joint almost stands
still, so a sign counts as any number from -1 to 1 and the effort of joint `j` is bounded by

$$\tau_j^\pm = \tau_j(s = 0) + \sum_i \max_{s_i \in \{-1, 0, 1\}} \text{ or } \min \;
  [\tau_j(s_i) - \tau_j(0)].$$

Friction is a sum over its signs, each of which may be switched off at low speed; so the bounds
hold for all signs together. They are continuous in the motion, as the effort itself is not.
"""

from collections.abc import Callable, Sequence

import numpy as np

from steelyard.model.equations.inverse_dynamics import Scalar, Scalars
from steelyard.symbolic.program_and_softening import Program
from steelyard.symbolic.symbols_and_tracing import replayed


def effort_range(
    smooth: Scalars, rough: Program | None, x: Sequence[Scalars], power: bool
) -> tuple[list[Scalar], list[Scalar]]:
    """The greatest and the least efforts at inputs `x` of position, velocity and so on.

    The efforts `smooth` have no sign in them, those of the program `rough` have. With `power` those
    of the power of every joint and of all together, not of the effort.
    """
    middle, most, least = _spread(smooth, rough, x)
    if power:
        return _powers(middle, most, least, x[1])
    high, low = ([a + b for a, b in zip(middle, part, strict=True)] for part in (most, least))
    return high, low


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


def _powers(
    middle: Scalars, most: Scalars, least: Scalars, dq: Scalars
) -> tuple[list[Scalar], list[Scalar]]:
    """Greatest powers of the joints and of all together, and the least."""
    own = [(m + 0.5 * (a + b)) * v for m, a, b, v in zip(middle, most, least, dq, strict=True)]
    ways = [0.5 * (a - b) * np.abs(v) for a, b, v in zip(most, least, dq, strict=True)]
    own, ways = [*own, sum(own[1:], own[0])], [*ways, sum(ways[1:], ways[0])]
    pairs = list(zip(own, ways, strict=True))
    return [a + b for a, b in pairs], [a - b for a, b in pairs]

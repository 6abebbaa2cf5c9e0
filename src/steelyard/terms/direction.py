"""The direction of a velocity: its sign, or a smooth law that turns within a speed."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from steelyard.errors import ModelError
from steelyard.kernel.equations.dynamics import Scalar
from steelyard.terms.axes import Axis, per_axis
from steelyard.terms.open_fields import Find

SHAPES: dict[str, Callable[[Scalar], Scalar]] = {
    "tanh": np.tanh,
    "arctan": lambda x: 2.0 / np.pi * np.arctan(x),
    # 2 / (1 + exp(-x)) - 1, without overflow
    "logistic": lambda x: np.tanh(0.5 * x),
}
"""Smooth laws over the velocity in units of the smoothing speed; from -1 to 1, odd."""

DEFAULT_SHAPE = "tanh"

Field = float | tuple[float, ...]
"""One value for all coordinates of a term, or one per coordinate."""


def directions(
    axes: Sequence[Axis],
    dq: Sequence[Scalar],
    smoothing: Field,
    law: str,
    shape: str = DEFAULT_SHAPE,
) -> list[Scalar]:
    r"""Direction of motion along every axis, from -1 to 1.

    Args:
        axes: The coordinates.
        dq: All joints' velocities [rad/s; m/s].
        smoothing: Speed $w$ of the smooth law $s(v/w)$; zero for the sign.
        law: Name of the term, for messages.
        shape: A name of `SHAPES`.
    """
    speeds = [axis.of(dq) for axis in axes]
    if is_zero(smoothing):
        return [np.sign(speed) for speed in speeds]
    widths = per_axis(smoothing, axes, law)
    return [SHAPES[shape](v / w) for v, w in zip(speeds, widths, strict=True)]


def is_zero(value: Any) -> bool:
    """Whether a field is the number zero, which switches it off."""
    return isinstance(value, float | int) and value == 0.0


def refuse_shape(law: str, shape: str, smoothing: Field) -> None:
    """The name of a smooth law goes with a speed within which it turns.

    Raises:
        ModelError: There is no such law, or no such speed.
    """
    refuse_unknown(law, "shape", shape, tuple(SHAPES))
    if is_zero(smoothing) and shape != DEFAULT_SHAPE:
        raise ModelError(
            f"term '{law}' has shape = {shape!r}, but its direction is the plain sign",
            where="list of terms",
            fix="give `smoothing`, the speed within which it turns, or leave out `shape`",
        )


def refuse_negative(law: str, **fields: Any) -> None:
    """Fields that are speeds or lengths are finite numbers, not negative; or still to be found.

    Raises:
        ModelError: One is not.
    """
    for name, value in fields.items():
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, Find):
                continue
            if not isinstance(number, float | int) or not 0.0 <= number < float("inf"):
                raise ModelError(
                    f"term '{law}' has {name} = {number!r}",
                    where="list of terms",
                    fix=f"give '{name}' as a positive number, one for all or a list with one per "
                    "coordinate",
                )


def refuse_not_positive(law: str, **fields: Any) -> None:
    """Fields that a law divides by are finite numbers above zero; or still to be found.

    Raises:
        ModelError: One is not.
    """
    refuse_negative(law, **fields)
    for name, value in fields.items():
        if 0.0 in (value if isinstance(value, tuple) else (value,)):
            raise ModelError(
                f"term '{law}' has {name} = {value!r}",
                where="list of terms",
                fix=f"give '{name}' above zero; to leave the effect out, leave out the term",
            )


def refuse_unknown(law: str, name: str, value: Any, known: Sequence[Any]) -> None:
    """A field with a choice has one of its values.

    Raises:
        ModelError: It has another.
    """
    if value not in known:
        raise ModelError(
            f"term '{law}' has {name} = {value!r}",
            where="list of terms",
            fix=f"give '{name}' one of {', '.join(repr(x) for x in known)}",
        )

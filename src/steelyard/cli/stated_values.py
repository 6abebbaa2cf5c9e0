"""Values of drives as text, in an option or an answer: one per joint, or a coupling."""

from collections.abc import Sequence

import numpy as np

from steelyard.errors import ModelError
from steelyard.robot.robot import Coordinate
from steelyard.robot_file.signals import looks_like_degrees
from steelyard.suggest import advice


def parsed(text: str, count: int) -> tuple[float, ...] | None:
    """So many finite numbers, separated by commas or spaces; `None` if they are not."""
    try:
        values = tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        return None
    finite = all(abs(value) < float("inf") for value in values)
    return values if len(values) == count and finite else None


def numbers(text: str, moving: Sequence[Coordinate], where: str) -> tuple[float, ...]:
    """One number other than zero for each joint.

    Args:
        text: Numbers with commas.
        moving: The joints.
        where: The option, for messages.

    Raises:
        ModelError: The text is something else.
    """
    found = parsed(text, len(moving))
    if found is None or not all(found):
        raise ModelError(
            f"'{text}' is not {len(moving)} numbers other than zero",
            where=where,
            fix="give one for each of " + ", ".join(c.name for c in moving) + ", with commas",
        )
    return found


def positions(text: str, moving: Sequence[Coordinate], where: str) -> tuple[float, ...]:
    """One position for each joint [rad; m]: numbers in rad (m), or with `deg` behind them.

    Raises:
        ModelError: The text is something else.
    """
    words = text.replace(",", " ").split()
    turned = [word.endswith("deg") for word in words]
    plain = parsed(" ".join(word.removesuffix("deg") for word in words), len(moving))
    if plain is None:
        names = ", ".join(c.name for c in moving)
        raise ModelError(
            f"'{text}' is not {len(moving)} positions",
            where=where,
            fix=f"give one for each of {names}, with commas, such as 0,-90deg,1.5708",
        )
    for x, in_degrees, coordinate in zip(plain, turned, moving, strict=True):
        if not in_degrees and looks_like_degrees(x, coordinate):
            raise ModelError(
                f"positions are in rad: {x:g} of '{coordinate.name}' looks like degrees",
                where=where,
                fix=f"write {x:g}deg",
            )
    return tuple(float(np.deg2rad(x)) if d else x for x, d in zip(plain, turned, strict=True))


def coupled(text: str, moving: Sequence[Coordinate], where: str) -> tuple[int, int, float]:
    """Motor and second joint by number, and the ratio, of MOTOR,JOINT,RATIO.

    A motor goes by the joint that it drives, or by its number, as `motor_6`.

    Raises:
        ModelError: The text is something else.
    """
    names = [c.name for c in moving]
    words = [word.strip() for word in text.split(",")]
    ratio = parsed(words[-1], 1)
    if len(words) != 3 or ratio is None or not ratio[0]:
        raise ModelError(
            f"'{text}' is not MOTOR,JOINT,RATIO",
            where=where,
            fix="write the motor by the joint that it drives, such as "
            f"{names[-1]},{names[-2:][0]},32",
        )
    motors = {f"motor_{k + 1}": name for k, name in enumerate(names)}
    words[0] = motors.get(words[0], words[0]) if words[0] not in names else words[0]
    for name in words[:2]:
        if name not in names:
            raise ModelError(
                f"there is no joint '{name}'", where=where, fix=advice(name, names, "joints")
            )
    return names.index(words[0]), names.index(words[1]), ratio[0]

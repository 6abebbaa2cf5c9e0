"""Base parameters under the symbols that are customary for them, like `XX2R` or `MY3`.

Letters name the number of a body's ten (`M, MX, MY, MZ, XX, XY, YY, XZ, YZ, ZZ`, about the link
frame's origin) or the law, the figure the link or joint, and `R` says that others are grouped with
it [Khalil2002, ch. 9].
"""

from steelyard.regression.base import BaseMap
from steelyard.robot.inertia import INERTIAL_NAMES
from steelyard.robot.robot import Robot
from steelyard.terms.register import TERMS

TEN = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")
LETTERS = {
    **dict(zip(INERTIAL_NAMES, TEN, strict=True)),
    **{law: term.symbol for law, term in TERMS.items() if term.symbol},
}
"""Letters of a parameter by what stands before the dot of its name."""


def symbol(robot: Robot, base: BaseMap, number: int) -> str:
    """The customary symbol of a base parameter; its own name where none is customary.

    Args:
        robot: Gives links and joints their numbers.
        base: The base parameters.
        number: Which of them.
    """
    name = base.base_names[number]
    kind, _, of = name.partition(".")
    if kind not in LETTERS:
        return name
    owners = [b.name for b in robot.bodies] if kind in INERTIAL_NAMES else list(robot.joint_names)
    place = str(owners.index(of) + 1) if of in owners else f"_{of}"
    grouped = "R" if base.coefficients[number].any() else ""
    return f"{LETTERS[kind]}{place}{grouped}"


def symbols(robot: Robot, base: BaseMap) -> tuple[str, ...]:
    """The customary symbols of all base parameters."""
    return tuple(symbol(robot, base, number) for number in range(len(base)))

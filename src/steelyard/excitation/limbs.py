r"""Limbs: joints whose efforts have parameters of their own, and what a search gains from that.

The torque of a joint tells of the bodies that it carries and of its own friction. Branches of a
tree that hang on the fixed base share no parameter, and no torque of one depends on the motion of
another: the information is block-diagonal, $\log\det G = \sum_l \log\det G_l$, exactly. Joints
that carry several branches, like those of a torso, make one limb of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.criteria import DOptimal
from steelyard.excitation.objective import Objective
from steelyard.excitation.walls import Walls
from steelyard.regression.gradient import Shows

TRIED = 5
"""Motions of one limb that are tried beside those of the others before it keeps its own."""


SHARPNESS = 64.0
"""Of the criterion by which whole motions are compared."""


@dataclass(frozen=True)
class Limb:
    """Joints whose efforts share parameters, directly or by way of others.

    Attributes:
        joints: Numbers of the joints, ascending.
        columns: Base parameters that their efforts tell of, ascending.
    """

    joints: tuple[int, ...]
    columns: tuple[int, ...]


def limbs_of(shows: Shows) -> tuple[Limb, ...]:
    """The limbs of a robot, by their first joints; one of all joints where loops close.

    Joints that tell of no base parameter are limbs by themselves.
    """
    sees = [set(columns) for columns in shows.sees]
    if shows.model.robot.passive:
        return (Limb(tuple(range(len(sees))), tuple(sorted(set().union(*sees)))),)
    found: list[tuple[set[int], set[int]]] = []
    for joint, columns in enumerate(sees):
        joints, told = {joint}, set(columns)
        apart = []
        for others, known in found:
            if known & told:
                joints |= others
                told |= known
            else:
                apart.append((others, known))
        found = [*apart, (joints, told)]
    limbs = [Limb(tuple(sorted(joints)), tuple(sorted(told))) for joints, told in found]
    return tuple(sorted(limbs, key=lambda limb: limb.joints))


def composed(
    objective: Objective, walls: Walls, limbs: Sequence[Limb], motions: Sequence[Array]
) -> Array:
    """Of motions inside the walls the best, and of every limb the best that fits to it.

    What a limb shows does not depend on the others: its best motion is looked for among all, by
    D-optimality of its own parameters. It takes the first that walls and criterion let it.

    Args:
        objective: What is minimised.
        walls: What may not be touched.
        limbs: The limbs.
        motions: Coefficients, each of shape `(n, m)`; the first is the best as a whole.

    Returns:
        Coefficients inside the walls, shape `(n, m)`.
    """
    best = motions[0]
    if len(limbs) < 2 or len(motions) < 2:
        return best
    least = objective.value(best, SHARPNESS)
    seen = [[s.gram for s in objective.seen(x)] for x in motions]
    for limb in limbs:
        own = np.ix_(limb.columns, limb.columns)
        values = np.array([max(_value(gram[own]) for gram in grams) for grams in seen])
        for k in np.argsort(values, kind="stable")[:TRIED]:
            if not values[k] < values[0]:
                break
            mixed = best.copy()
            mixed[list(limb.joints)] = motions[k][list(limb.joints)]
            value = objective.value(mixed, SHARPNESS) if walls.worst(mixed) > 0.0 else np.inf
            if value < least:
                best, least = mixed, value
                break
    return best


def _value(gram: Array) -> float:
    """D-optimality; what is not definite is infinite, of no parameters zero."""
    return DOptimal().smooth(gram, 1.0)[0] if len(gram) else 0.0

r"""Limbs: joints whose efforts have parameters of their own, and what a search gains from that.

The torque of a joint depends on the bodies that it carries and on its own friction. Branches of a
tree that hang on the fixed base share no parameter, and no torque of one depends on the motion of
another: the information is block-diagonal, $\log\det G = \sum_l \log\det G_l$, exactly. Joints
that carry several branches, like those of a torso, make one limb of them.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.barrier import InequalityConstraints
from steelyard.excitation.criteria.criteria import DOptimal
from steelyard.excitation.objective import Objective
from steelyard.regression.information_gradient import InformationEvaluator

SHARPNESS = 4.0
"""Of the criterion by which motions are compared before they are improved."""


@dataclass(frozen=True)
class Limb:
    """Joints whose efforts share parameters, directly or by way of others.

    Attributes:
        joints: Numbers of the joints, ascending.
        columns: Base parameters that their efforts depend on, ascending.
    """

    joints: tuple[int, ...]
    columns: tuple[int, ...]


def limbs_of(shows: InformationEvaluator) -> tuple[Limb, ...]:
    """The limbs of a robot, by their first joints; one of all joints where loops close.

    Joints whose efforts depend on no base parameter are limbs by themselves.
    """
    sees = [set(columns) for columns in shows.sees]
    if shows.model.robot.passive:
        return (Limb(tuple(range(len(sees))), tuple(sorted(set().union(*sees)))),)
    found: list[tuple[set[int], set[int]]] = []
    for joint, columns in enumerate(sees):
        joints, reached = {joint}, set(columns)
        apart = []
        for others, known in found:
            if known & reached:
                joints |= others
                reached |= known
            else:
                apart.append((others, known))
        found = [*apart, (joints, reached)]
    limbs = [Limb(tuple(sorted(joints)), tuple(sorted(reached))) for joints, reached in found]
    return tuple(sorted(limbs, key=lambda limb: limb.joints))


def composed(
    objective: Objective,
    inequalities: InequalityConstraints,
    limbs: Sequence[Limb],
    motions: Iterable[Array],
) -> Iterator[Array]:
    """The best of motions in the feasible set so far, after each of them, mixed limb by limb.

    What a limb shows does not depend on the others: where another motion shows its parameters
    better, by D-optimality, the limb takes it over as far as constraints and criterion permit.

    Args:
        objective: What is minimised.
        inequalities: Inequality constraints of the motion.
        limbs: The limbs.
        motions: Coefficients, each of shape `(n, m)`.

    Yields:
        Coefficients in the feasible set, shape `(n, m)`; as many as there are motions.
    """
    best: _Mixed | None = None
    for x in motions:
        one = _Mixed.of(objective, limbs, x)
        if best is None:
            best = one
        else:
            first, second = (best, one) if best.value <= one.value else (one, best)
            best = first.with_limbs_of(second, objective, inequalities, limbs)
        yield best.x


@dataclass(frozen=True, eq=False)
class _Mixed:
    """A motion, its criterion, and that of every limb."""

    x: Array
    value: float
    each: tuple[float, ...]

    @classmethod
    def of(cls, objective: Objective, limbs: Sequence[Limb], x: Array) -> "_Mixed":
        value = objective.value(x, SHARPNESS)
        if len(limbs) < 2:
            return cls(x, value, ())
        grams = [seen.gram for seen in objective.seen(x)]
        parts = [np.ix_(limb.columns, limb.columns) for limb in limbs]
        return cls(x, value, tuple(max(_value(g[part]) for g in grams) for part in parts))

    def with_limbs_of(
        self,
        other: "_Mixed",
        objective: Objective,
        inequalities: InequalityConstraints,
        limbs: Sequence[Limb],
    ) -> "_Mixed":
        """The motion with those of the other's limbs that show more, if they fit to it."""
        best = self
        for number, (limb, new) in enumerate(zip(limbs, other.each, strict=False)):
            if not new < best.each[number]:
                continue
            x = best.x.copy()
            x[list(limb.joints)] = other.x[list(limb.joints)]
            value = (
                objective.value(x, SHARPNESS) if inequalities.smallest_margin(x) > 0.0 else np.nan
            )
            if value <= best.value:
                each = (*best.each[:number], new, *best.each[number + 1 :])
                best = _Mixed(x, value, each)
        return best


def _value(gram: Array) -> float:
    """D-optimality; what is not definite is infinite, of no parameters zero."""
    return DOptimal().smooth(gram, 1.0)[0] if len(gram) else 0.0

r"""Estimated zero offsets of joints as evidence, and zeros that are quarter turns away.

Controllers and model files often count joints from postures that are 90 or 180 degrees apart. Such
offsets are far beyond the reach of derivatives, and look like wrong lengths: the offset of one
joint turns the link behind it, and an opposite one of the next joint turns the others back. The
joints are therefore read with quarter turns, of one joint or of neighbours, one after another as
long as weighted least squares fits better, by $-2 \log L = \sum_j N_j \log \sigma_j^2$. Motion
that is left out then decides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.check.finding import Edit, Fix
from steelyard.check.fitted.causes import WORTH_A_SEARCH, LeftOutGain, LeftOutParts
from steelyard.check.fitted.fitted_case import first_parts_of_runs
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.information.base_parameters import base_parameters
from steelyard.estimate.information.regressor import Regressor, base_regressor
from steelyard.estimate.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimate.least_squares.normal_equations import own_columns
from steelyard.estimate.nonlinear.fields import information_from
from steelyard.estimate.nonlinear.zero_offset import ZeroOffsets, find_offsets, with_offsets
from steelyard.model.model import Model
from steelyard.robot.robot import Robot
from steelyard.runs.run import Run

CLEAR_OFFSET = 4.0
"""Standard deviations from what is given at which a zero offset is written as a number."""

UPRIGHT_AXIS = 0.05
"""Part of gravity across a first axis up to which it is taken to be along it [m/s²]."""


def estimated_offsets(model: Model, runs: Sequence[Run]) -> ZeroOffsets | None:
    """Zero offsets of all joints, from those that the runs are read with; `None` of too few data.

    The robot is an open chain.
    """
    given, rests = runs[0].recording.signals.position_offset, has_memory(model.terms)
    start = np.zeros(model.robot.n) if given is None else given
    try:
        return find_offsets(
            model,
            lambda offsets: information_from(with_offsets(runs, offsets), rests=rests),
            start,
            [True] * model.robot.n,
        )
    except DataError:
        return None


def far_offsets(offsets: ZeroOffsets) -> NDArray[np.bool_]:
    """Which offsets differ clearly from those that were given, shape `(n,)`."""
    spread = np.nan_to_num(offsets.std, nan=np.inf)
    return np.asarray(
        (np.abs(offsets.values - offsets.start) > CLEAR_OFFSET * spread) & offsets.converged
    )


def zeros_without_effect(robot: Robot) -> tuple[bool, ...]:
    """Joints whose zeros no motion identifies, for parameters express them, or none has an effect.

    A first joint that turns about the direction of gravity or slides, and joints of last bodies.
    """
    parents = {body.parent for body in robot.bodies}
    found = [False] * robot.n
    for k, body in enumerate(robot.bodies):
        along = np.linalg.norm(np.cross(body.rotation @ body.axis, robot.gravity))
        first = body.parent < 0 and (body.kind == "prismatic" or along <= UPRIGHT_AXIS)
        if body.coordinate < robot.n and (first or k not in parents):
            found[body.coordinate] = True
    return tuple(found)


def offset_words(offsets: ZeroOffsets, chosen: NDArray[np.bool_]) -> str:
    """Like `zero offset of elbow 0.4992 ± 0.0008 rad`."""
    parts = [
        f"{offsets.joints[k]} {offsets.values[k]:.4f} ± {offsets.half_width[k]:.4f} "
        f"{offsets.units[k]}"
        for k in np.flatnonzero(chosen)
    ]
    return f"zero offset of {', '.join(parts)}"


def offset_line(offsets: ZeroOffsets, chosen: NDArray[np.bool_]) -> Fix:
    """The line of the robot file that corrects offsets; others stay as they are given."""
    values = [
        round(float(value), 4) if far else float(start)
        for value, start, far in zip(offsets.values, offsets.start, chosen, strict=True)
    ]
    says = f'Set position_offset = {values} in [signals], or position_offset = "identify"'
    return Fix(says, (Edit(("signals", "position_offset"), values),))


TurnedJoints = tuple[tuple[int, float], ...]
"""Joints by their indices, and by how much each is turned [rad]."""

TRIED_TURNS = (0.5 * np.pi, -0.5 * np.pi, np.pi)
"""Offsets of a joint that are tried [rad]."""

CLEAR_TURN_FALL = 40.0
r"""Fall of $-2 \log L$ that another turned joint must be worth: by chance one of 18 turns is worth
15 once in a hundred fits, and residuals that are alike for longer than the filter count more."""

NO_TURN_EFFECT = 1e-3
"""Change of it up to which the zero of a joint has no effect: as about the direction of gravity."""

IF_CONFIRMED = (
    "if the robot's zeros confirm it; otherwise the origin or the axis of the next joint is turned "
    "by as much in the model file: correct it there"
)
"""What else has the effect of a turned zero, for people to read."""

MOST_TURN_SAMPLES = 20_000
"""Samples that are looked at: every turn of every joint is a pass over them."""


@dataclass(frozen=True, eq=False)
class TurnedZeros:
    """Joint zeros with which other motion is predicted better.

    Attributes:
        joints: Names of the turned joints.
        degrees: By how much each is turned.
        offsets: Positions where the log has zero, shape `(n,)` [rad; m].
        gain: Errors on left-out motion without and with them.
    """

    joints: tuple[str, ...]
    degrees: tuple[float, ...]
    offsets: tuple[float, ...]
    gain: LeftOutGain

    @property
    def says(self) -> str:
        """What was found, in a few words."""
        each = zip(self.joints, self.degrees, strict=True)
        listed = ", ".join(f"{joint} {degrees:+.0f}°" for joint, degrees in each)
        return (
            f"joint zeros other than those of the model file: {listed} (error on left-out motion "
            f"{self.gain.before:.2g} %, with these zeros {self.gain.after:.2g} %)"
        )

    @property
    def fix(self) -> Fix:
        """The line of the robot file."""
        values = [round(value, 4) for value in self.offsets]
        return Fix(
            f"Set position_offset = {values} in [signals], {IF_CONFIRMED}",
            (Edit(("signals", "position_offset"), values),),
        )


def turned_zeros(model: Model, sigma: Array, runs: Sequence[Run]) -> TurnedZeros | None:
    """Quarter turns of joints that explain residuals and predict left-out motion better.

    Args:
        model: The fitted model, an open chain.
        sigma: Standard deviations of the fit's residuals, shape `(n,)`.
        runs: The fitted runs.
    """
    some, regressor = first_parts_of_runs(runs, MOST_TURN_SAMPLES), base_regressor(model)
    given = some[0].recording.signals.position_offset
    start = np.zeros(model.robot.n) if given is None else given
    try:
        found = _search_turns(regressor, some, start)
        turned = np.flatnonzero(found != start)
        if not turned.size:
            return None
        names = base_parameters(model).base_names
        without, within = (
            LeftOutParts.of(model, regressor, sigma, with_offsets(some, offsets))
            for offsets in (start, found)
        )
        plain, errors = (parts.errors(names) for parts in (without, within))
        gain = LeftOutGain.of(plain, errors, without.left_out, WORTH_A_SEARCH)
    except DataError:
        return None
    joints = tuple(model.robot.joint_names[k] for k in turned)
    degrees = np.rad2deg(found - start)[turned].tolist()
    return (
        TurnedZeros(joints, tuple(degrees), tuple(found.tolist()), gain) if gain.confirmed else None
    )


def _search_turns(regressor: Regressor, runs: Sequence[Run], start: Array) -> Array:
    """Offsets with the best fit; each joint is turned once at most, alone or with the next one."""
    units = [coordinate.unit for coordinate in regressor.model.robot.coordinates]
    left = [k for k, unit in enumerate(units) if unit == "rad"]
    offsets, least = start, _turn_misfit(regressor, runs, start)
    while left:
        tried: dict[TurnedJoints, float] = {}
        for joints in (1, 2):
            for turned in quarter_turns_of_joints(left, joints):
                tried[turned] = _turn_misfit(regressor, runs, _turned_by(offsets, turned))
            moved = {
                k for ((k, _), *_), found in tried.items() if abs(found - least) > NO_TURN_EFFECT
            }
            left = [k for k in left if k in moved]
        if not tried or min(tried.values()) > least - CLEAR_TURN_FALL:
            break
        best = min(tried, key=lambda turned: tried[turned])
        left = [k for k in left if k not in dict(best)]
        offsets, least = _turned_by(offsets, best), tried[best]
    return offsets


def quarter_turns_of_joints(left: Sequence[int], joints: int) -> Iterator[TurnedJoints]:
    """Turns of every joint alone, or of neighbours such that later links keep their orientation."""
    if joints == 1:
        yield from (((k, turn),) for k in left for turn in TRIED_TURNS)
        return
    for k in (k for k in left if k + 1 in left):
        for turn, other in product(TRIED_TURNS, TRIED_TURNS):
            if abs(turn) == abs(other):
                yield (k, turn), (k + 1, other)


def _turned_by(offsets: Array, turned: TurnedJoints) -> Array:
    found = offsets.copy()
    for joint, turn in turned:
        found[joint] += turn
    return found


def _turn_misfit(regressor: Regressor, runs: Sequence[Run], offsets: Array) -> float:
    r"""$-2 \log L$ of weighted least squares, but for a constant."""
    model = regressor.model
    read = information_from(with_offsets(runs, offsets), rests=has_memory(model.terms))
    information = read(regressor)
    fit = WeightedLeastSquares(per_run=own_columns(model)).fit(information)
    return float(information.n_samples @ np.log(fit.variances))

r"""Joint zeros that are quarter turns away from those of the model file.

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

from steelyard.arrays import Array
from steelyard.diagnosis.finding import Edit, Fix
from steelyard.diagnosis.left_out_gain import WORTH_A_SEARCH, LeftOutGain, Parts
from steelyard.diagnosis.ranked_causes import beginnings
from steelyard.errors import DataError
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.per_run import own_columns
from steelyard.estimation.zero_offset import with_offsets
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.regression.base import base_parameters
from steelyard.regression.regressor import Regressor, base_regressor
from steelyard.validation.friction.mixes import remembers

Turned = tuple[tuple[int, float], ...]
"""Joints by their indices, and by how much each is turned [rad]."""

TURNS = (0.5 * np.pi, -0.5 * np.pi, np.pi)
"""Offsets of a joint that are tried [rad]."""

CLEAR = 40.0
r"""Fall of $-2 \log L$ that another turned joint must be worth: by chance one of 18 turns is worth
15 once in a hundred fits, and residuals that are alike for longer than the filter count more."""

NO_EFFECT = 1e-3
"""Change of it up to which the zero of a joint has no effect: as about the direction of gravity."""

IF_CONFIRMED = (
    "if the robot's zeros confirm it; otherwise the origin or the axis of the next joint is turned "
    "by as much in the model file: correct it there"
)
"""What else has the effect of a turned zero, for people to read."""

MOST_SAMPLES = 20_000
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
    some, regressor = beginnings(runs, MOST_SAMPLES), base_regressor(model)
    given = some[0].recording.signals.position_offset
    start = np.zeros(model.robot.n) if given is None else given
    try:
        found = _search(regressor, some, start)
        turned = np.flatnonzero(found != start)
        if not turned.size:
            return None
        names = base_parameters(model).base_names
        without, within = (
            Parts.of(model, regressor, sigma, with_offsets(some, offsets))
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


def _search(regressor: Regressor, runs: Sequence[Run], start: Array) -> Array:
    """Offsets with the best fit; each joint is turned once at most, alone or with the next one."""
    units = [coordinate.unit for coordinate in regressor.model.robot.coordinates]
    left = [k for k, unit in enumerate(units) if unit == "rad"]
    offsets, least = start, _misfit(regressor, runs, start)
    while left:
        tried: dict[Turned, float] = {}
        for joints in (1, 2):
            for turned in turns(left, joints):
                tried[turned] = _misfit(regressor, runs, _at(offsets, turned))
            moved = {k for ((k, _), *_), found in tried.items() if abs(found - least) > NO_EFFECT}
            left = [k for k in left if k in moved]
        if not tried or min(tried.values()) > least - CLEAR:
            break
        best = min(tried, key=lambda turned: tried[turned])
        left = [k for k in left if k not in dict(best)]
        offsets, least = _at(offsets, best), tried[best]
    return offsets


def turns(left: Sequence[int], joints: int) -> Iterator[Turned]:
    """Turns of every joint alone, or of neighbours such that later links keep their orientation."""
    if joints == 1:
        yield from (((k, turn),) for k in left for turn in TURNS)
        return
    for k in (k for k in left if k + 1 in left):
        for turn, other in product(TURNS, TURNS):
            if abs(turn) == abs(other):
                yield (k, turn), (k + 1, other)


def _at(offsets: Array, turned: Turned) -> Array:
    found = offsets.copy()
    for joint, turn in turned:
        found[joint] += turn
    return found


def _misfit(regressor: Regressor, runs: Sequence[Run], offsets: Array) -> float:
    r"""$-2 \log L$ of weighted least squares, but for a constant."""
    model = regressor.model
    read = information_from(with_offsets(runs, offsets), rests=remembers(model.terms))
    information = read(regressor)
    fit = WeightedLeastSquares(per_run=own_columns(model)).fit(information)
    return float(information.n_samples @ np.log(fit.variances))

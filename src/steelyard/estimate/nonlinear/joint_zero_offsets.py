r"""Joint zero offsets, estimated together with all parameters by Gauss-Newton steps.

With $q + \delta$ in place of the logged $q$, the torque is $Y(q + \delta)\,\phi$: linear in the
parameters, not in the offsets. A step fits both to the columns
$[\,Y \;\; \partial (Y \phi) / \partial q\,]$ at the offsets and parameters that were reached, by
weighted least squares [Gautier1997]; friction may differ from run to run as the model says.

What the data identify, the columns themselves show. The first joint's offset turns the robot about
its axis: with that axis along gravity nothing changes. The last joint's turns the last body about
its axis, which its parameters express as well. Such offsets have no column of their own, or a
standard deviation beyond `LOOSEST`; they are left as they are, and named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, finite_json, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Z95, Estimate
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.least_squares.normal_equations import own_columns
from steelyard.estimate.least_squares.weighted_and_recursive import WeightedLeastSquares
from steelyard.estimate.nonlinear.grid_search import InformationOf
from steelyard.estimate.nonlinear.nonlinear_parameters import bodies_of
from steelyard.model.model import Model
from steelyard.model.terms.geometry_and_effort_errors import GeometryErrors
from steelyard.runs.run import Run

ROUNDS = 20  # most Gauss-Newton steps
LONGEST = 0.25  # longest step of an offset [rad; m]: derivatives hold for small angles only
LOOSEST = {"rad": 0.1, "m": 0.05}  # standard deviation of what is not identifiable
CONVERGED = 0.02  # step in standard deviations at which the search has converged
LAW = "zero_offset"


@dataclass(frozen=True, eq=False)
class ZeroOffsets:
    """Estimated offsets: joint position = logged position + offset."""

    joints: tuple[str, ...]
    units: tuple[str, ...]  # `rad` or `m` per joint
    values: Array  # shape `(n,)`; of joints that are not identifiable as they were given
    start: Array  # what was given, shape `(n,)`
    std: Array  # their standard deviations, shape `(n,)`; NaN of what was not estimated
    wanted: tuple[bool, ...]  # whether each was to be estimated
    converged: bool

    @property
    def half_width(self) -> Array:
        """Half-width of the 95 % intervals, shape `(n,)`."""
        return Z95 * self.std

    def words(self, chosen: NDArray[np.bool_]) -> str:
        """Chosen offsets with their intervals, like `elbow 0.4992 ± 0.0008 rad`."""
        rows = zip(self.joints, self.values, self.half_width, self.units, chosen, strict=True)
        return ", ".join(
            f"{j} {x:.4f} ± {half:.4f} {unit}" for j, x, half, unit, is_one in rows if is_one
        )

    @property
    def note(self) -> str:
        """Values with their intervals, and what is not identifiable, for people to read."""
        known = np.isfinite(self.std)
        left = ", ".join(
            j
            for j, sure, wanted in zip(self.joints, known, self.wanted, strict=True)
            if wanted > sure
        )
        text = f"zero offsets identified: {self.words(known) or 'none'}"
        if left:
            text += f"; not identifiable from these data, left as given: {left}"
        return text if self.converged else f"{text}; the search did not converge"

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; `half_width` is `None` where an offset was not estimated."""
        return {
            "joints": list(self.joints),
            "units": list(self.units),
            "values": self.values.tolist(),
            "half_width": finite_json(self.half_width),
            "converged": self.converged,
        }


def with_offsets(runs: Sequence[Run], offsets: Array) -> tuple[Run, ...]:
    """The runs with joint positions that many radians or metres from what was logged."""
    return tuple(run.displaced(offsets) for run in runs)


def find_offsets(
    model: Model,
    information_at: Callable[[Array], InformationOf],
    start: Array,
    wanted: Sequence[bool],
) -> ZeroOffsets:
    """Estimate zero offsets of an open chain.

    Those that are not wanted stay at their start, `(n,)`; `information_at` is what the runs say
    about a regressor with offsets `(n,)`.

    Raises:
        DataError: The robot has closed chains.
    """
    if model.robot.passive:
        raise DataError(
            "zero offsets of closed chains cannot be estimated",
            where=f"robot '{model.robot.name}'",
            fix="give position_offset = [...] in [signals]",
        )
    fit = WeightedLeastSquares(per_run=own_columns(model))
    values, spread, converged = start.copy(), np.full(len(start), np.nan), False
    bodies = bodies_of(fit(information_at(values.copy())(base_regressor(model))))
    for _ in range(ROUNDS):
        wide = replace(model, terms=(*model.terms, GeometryErrors(reference=tuple(bodies.items()))))
        information = information_at(values.copy())(base_regressor(wide))
        estimate, step, spread = offset_step(information, fit, model, wanted)
        bodies = bodies_of(estimate)
        moved = np.nan_to_num(step)
        values += moved * min(1.0, LONGEST / max(float(np.abs(moved).max()), 1e-300))
        if np.all(np.abs(moved) <= CONVERGED * np.nan_to_num(spread, nan=np.inf)):
            converged = True
            break
    joints, units = model.robot.joint_names, tuple(c.unit for c in model.robot.coordinates)
    arrays = frozen(values), frozen(start), frozen(spread)
    return ZeroOffsets(joints, units, *arrays, tuple(wanted), converged)


def offset_step(
    information: Information, fit: WeightedLeastSquares, model: Model, wanted: Sequence[bool]
) -> tuple[Estimate, Array, Array]:
    """One step: the joint estimate, offsets to add and their standard deviations.

    The information is of the model's columns and those of all offsets. Columns of offsets that the
    data do not identify are taken out one by one, the loosest first.
    """
    joints = model.robot.joint_names
    own = {f"{LAW}.{joint}": k for k, joint in enumerate(joints)}
    left = [name for name, k in own.items() if wanted[k]]
    while True:
        columns = [c for c in information.layout.columns if c not in own or c in left]
        estimate = fit(information.select(columns))
        stds = dict(zip(estimate.parameters.names, estimate.std.tolist(), strict=True))
        loose = {
            name: stds.get(name, np.inf) / LOOSEST[model.robot.coordinates[own[name]].unit]
            for name in left
        }
        worst = max(loose, key=lambda name: loose[name], default=None)
        if worst is None or loose[worst] <= 1.0:
            break
        left.remove(worst)
    known = estimate.parameters.as_dict()
    step, spread = np.full((2, len(joints)), np.nan)
    for name in left:
        step[own[name]], spread[own[name]] = known[name], stds[name]
    return estimate, step, spread

"""Scores on a run that was not fitted: how far the predicted effort is from the measured one.

Per joint `100 ‖measured - predicted‖ / ‖measured‖`, from first to last motion, both sides through
one zero-phase fourth-order Butterworth low-pass; once over all samples, once over those where the
joint moves.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, tee
from math import isfinite, sqrt
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.measurement.chunks import apply
from steelyard.measurement.methods.lowpass import low_pass, require_fitting
from steelyard.measurement.run import Block, Run
from steelyard.model import ValuedModel
from steelyard.regression.gather import Mask, along
from steelyard.validation.bands import Bands
from steelyard.validation.traces import Sure, Thinned
from steelyard.validation.traces import Traces as Traces


@dataclass(frozen=True)
class JointScore:
    """Errors of one joint, in the unit of its logged effort.

    Attributes:
        joint: The joint.
        unit: `A`, `Nm` or `N`.
        relative_percent: Error relative to the measured effort, all samples [%].
        relative_percent_moving: The same where the joint moves; `None` if it never does.
        rmse: Root mean square error.
        predict_zero: RMSE of predicting zero: the measured effort's own root mean square.
        prior_rmse: RMSE of the nominal model of the robot's file; `None` if there is none.
    """

    joint: str
    unit: str
    relative_percent: float
    relative_percent_moving: float | None
    rmse: float
    predict_zero: float
    prior_rmse: float | None


@dataclass(frozen=True, eq=False)
class RunScore:
    """Scores of one run.

    Attributes:
        run: The run's name.
        cutoff: Cut-off of the low-pass on both sides [Hz].
        joints: One score per joint.
        pooled_percent: Norms taken over all joints together [%]; `None` if units differ.
        pooled_percent_moving: The same where each joint moves.
        traces: The compared signals.
        repeats: The fitted run whose motion it repeats; empty if its motion is another one.
    """

    run: str
    cutoff: float
    joints: tuple[JointScore, ...]
    pooled_percent: float | None
    pooled_percent_moving: float | None
    traces: Traces
    repeats: str = ""

    @property
    def mean_percent(self) -> float:
        """Mean over joints of the relative error [%]."""
        return float(np.mean([j.relative_percent for j in self.joints]))

    @property
    def mean_percent_moving(self) -> float | None:
        """Mean over joints that move of the relative error where they move [%]."""
        moving = [j.relative_percent_moving for j in self.joints]
        known = [x for x in moving if x is not None]
        return float(np.mean(known)) if known else None

    @property
    def coverage_percent(self) -> float | None:
        """Share of the measurements in their 95 % bands, over all joints with a band [%]."""
        shares = self.traces.coverage
        known = np.empty(0) if shares is None else shares[np.isfinite(shares)]
        return 100.0 * float(known.mean()) if len(known) else None

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, without the traces; an error without a finite percentage is `None`."""
        figures = {
            "run": self.run,
            "motion": "repeated" if self.repeats else "unseen",
            "repeats": self.repeats or None,
            "cutoff": self.cutoff,
            "mean_percent": self.mean_percent,
            "mean_percent_moving": self.mean_percent_moving,
            "pooled_percent": self.pooled_percent,
            "pooled_percent_moving": self.pooled_percent_moving,
            "band_coverage_percent": self.coverage_percent,
        }
        return _finite(figures) | {"joints": [_finite(vars(joint)) for joint in self.joints]}


def score(
    valued: ValuedModel,
    run: Run,
    gains: Array,
    cutoff: float,
    prior: ValuedModel | None = None,
    bands: Bands | None = None,
) -> RunScore:
    """Compare a model with a run, block by block, in constant memory.

    Args:
        valued: The model.
        run: A run that was not fitted.
        gains: Joint effort per logged unit, shape `(n,)`.
        cutoff: Cut-off of the low-pass on both sides [Hz].
        prior: The same model with nominal values, to be scored beside it.
        bands: How sure the model is, for the traces.

    Raises:
        LogError: The cut-off is too high for the run's rate.
        DataError: The robot's loops close at no sample.
    """
    require_fitting(cutoff, run.rate)
    models = (valued,) if prior is None else (valued, prior)
    squares, thinned = _Squares(), Thinned()
    blocks = along(run.blocks(), valued.model)
    for _, of_segment in groupby(blocks, key=lambda block: block.segment):
        sure, known = None, np.empty((0, len(gains), 0))
        if bands is not None:
            of_segment, beside = tee(of_segment)
            sure = Sure(beside, bands, gains, cutoff, run.rate)
        for t, moving, efforts in _filtered(of_segment, models, gains, cutoff, run.rate):
            squares.add(efforts, moving)
            thinned.add(t, moving, efforts, known if sure is None else sure.next(len(t)))
    if not squares.samples:
        raise DataError(
            f"the loops of '{valued.model.robot.name}' close at no sample of the run",
            where=run.name,
            fix="check the loops' points and links, and the zeros and signs of the positions",
        )
    joints = tuple(
        squares.joint(j, coordinate.name, run.effort_units[j])
        for j, coordinate in enumerate(valued.model.robot.coordinates)
    )
    comparable = len(set(run.effort_units)) == 1
    error, size = squares.all[:2].sum(axis=1)
    error_moving, size_moving = squares.moving[:2].sum(axis=1)
    return RunScore(
        run=run.name,
        cutoff=cutoff,
        joints=joints,
        pooled_percent=_percent(error, size) if comparable else None,
        pooled_percent_moving=(
            _percent(error_moving, size_moving)
            if comparable and squares.samples_moving.any()
            else None
        ),
        traces=thinned.traces(None if bands is None else bands.sigma / np.abs(gains)),
    )


def _filtered(
    blocks: Iterable[Block], models: Sequence[ValuedModel], gains: Array, cutoff: float, rate: float
) -> Iterator[tuple[Array, Mask, Array]]:
    """Time, where each joint moves, and low-passed efforts of one segment, in parts.

    Yields:
        `(B,)`, `(n, B)`, and `(1 + models, n, B)`: measured, then predicted by each model.
    """
    known: list[tuple[Array, Mask]] = []

    def efforts() -> Iterator[Array]:
        for block in blocks:
            known.append((block.t, block.moving))
            predicted = (m.block(block.q, block.dq, block.ddq, block.channels) for m in models)
            yield np.concatenate((block.effort, *(tau / gains[:, None] for tau in predicted)))

    for part in apply(low_pass(cutoff, rate), efforts()):
        t = np.concatenate([t for t, _ in known])
        moving = np.concatenate([moving for _, moving in known], axis=1)
        count = part.shape[-1]
        known[:] = [(t[count:], moving[:, count:])]
        yield t[:count], moving[:, :count], part.reshape(1 + len(models), len(gains), -1)


class _Squares:
    """Sums of squares per joint: of the error, of the measured effort, of the nominal error.

    Attributes:
        all: Over all samples, shape `(3, n)`; two rows without a nominal model.
        moving: Where the joint moves.
        samples: Number of samples.
        samples_moving: The same where each joint moves, shape `(n,)`.
    """

    def __init__(self) -> None:
        self.all, self.moving = np.zeros((2, 1)), np.zeros((2, 1))
        self.samples, self.samples_moving = 0, np.zeros(1)

    def add(self, efforts: Array, moving: Mask) -> None:
        measured, predicted = efforts[0], efforts[1]
        parts = np.square([measured - predicted, measured, *(measured - efforts[2:])])
        if not self.samples:
            self.all = self.moving = np.zeros(parts.shape[:2])
        self.all = self.all + parts.sum(axis=2)
        self.moving = self.moving + np.where(moving, parts, 0.0).sum(axis=2)
        self.samples += moving.shape[1]
        self.samples_moving = self.samples_moving + moving.sum(axis=1)

    def joint(self, j: int, name: str, unit: str) -> JointScore:
        """Errors of one joint."""
        root = np.sqrt(self.all[:, j] / self.samples)
        return JointScore(
            joint=name,
            unit=unit,
            relative_percent=_percent(*self.all[:2, j]),
            relative_percent_moving=(
                _percent(*self.moving[:2, j]) if self.samples_moving[j] else None
            ),
            rmse=float(root[0]),
            predict_zero=float(root[1]),
            prior_rmse=float(root[2]) if len(root) > 2 else None,
        )


def _finite(figures: Mapping[str, Any]) -> dict[str, Any]:
    """JSON knows no infinity."""
    return {
        name: None if isinstance(value, float) and not isfinite(value) else value
        for name, value in figures.items()
    }


def _percent(error: float, reference: float) -> float:
    """Root of a sum of squared errors relative to another [%].

    A joint that draws no effort at all has no relative error: any error is then infinite.
    """
    if reference == 0.0:
        return 0.0 if error == 0.0 else float("inf")
    return 100.0 * sqrt(error / reference)

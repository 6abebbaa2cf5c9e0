"""Scores on a run that was not fitted: how far the predicted effort is from the measured one.

Per joint `100 ‖measured - predicted‖ / ‖measured‖`, from first to last motion, both sides through
one zero-phase fourth-order Butterworth low-pass; once over all samples, once over those where the
joint moves.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, tee, zip_longest
from math import sqrt
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Array, finite_json
from steelyard.base.errors import DataError
from steelyard.estimate.information.gather import Mask, blocks_with_channels
from steelyard.estimate.scores.bands import (
    MOST_DRAWN,
    BandChannels,
    Bands,
    Signals,
    Thinned,
    traces_of,
)
from steelyard.estimate.scores.bands import Traces as Traces
from steelyard.estimate.scores.joint_errors import BandErrors, EffortReference, band_errors, band_of
from steelyard.estimate.scores.residuals import MOST_KEPT, PARTS, TorqueParts, TorqueSplit
from steelyard.model.model import ValuedModel
from steelyard.runs.run import Block, Run
from steelyard.runs.smoothing.filters import apply, low_pass, require_fitting

CONTEXT = 6.0
"""Of the rests before and after a motion that belong to its filters and to friction with memory
[s]: with them an abrupt stop is low-passed with what follows it."""

_FilteredStretch = tuple[tuple[Array, Mask, Array, Array], Array]
"""Time, where each joint moves, positions and velocities, and efforts: measured, then predicted."""


@dataclass(frozen=True)
class JointScore:
    """Errors of one joint, in the unit of its logged effort."""

    joint: str
    unit: str  # `A`, `Nm` or `N`
    relative_percent: float  # error relative to the measured effort, all samples [%]
    relative_percent_moving: float | None  # the same where the joint moves; `None` if it never does
    rmse: float  # root mean square error, all samples
    rmse_moving: float | None  # the same where the joint moves; `None` if it never does
    mae: float  # mean absolute error, all samples
    mae_moving: float | None  # the same where the joint moves; `None` if it never does
    predict_zero: float  # RMSE of predicting zero: the measured effort's own root mean square
    prior_rmse: float | None  # of the nominal model of the robot's file, if there is one


@dataclass(frozen=True, eq=False)
class RunScore:
    """Scores of one run."""

    run: str
    cutoff: float  # cut-off of the low-pass on both sides [Hz]
    joints: tuple[JointScore, ...]
    pooled_percent: float | None  # norms taken over all joints together [%]; `None` if units differ
    pooled_percent_moving: float | None  # the same where each joint moves
    errors: BandErrors  # errors in the band that is fixed for all models
    traces: Traces
    repeats: str = ""  # the fitted run whose motion it repeats; empty if its motion is another one
    parts: TorqueParts | None = None  # efforts by their causes, if they were wanted
    predicted_from: Literal["measured", "commanded"] = "measured"  # the motion

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
            "predicted_from": self.predicted_from,
            "cutoff": self.cutoff,
            "mean_percent": self.mean_percent,
            "mean_percent_moving": self.mean_percent_moving,
            "pooled_percent": self.pooled_percent,
            "pooled_percent_moving": self.pooled_percent_moving,
            "band_coverage_percent": self.coverage_percent,
        }
        joints = [vars(joint) for joint in self.joints]
        return dict(finite_json(figures | {"headline": self.errors.to_dict(), "joints": joints}))


def score(
    valued: ValuedModel,
    run: Run,
    gains: Array,
    cutoff: float,
    prior: ValuedModel | None = None,
    bands: Bands | None = None,
    split: TorqueSplit | None = None,
    reference: EffortReference | None = None,
) -> RunScore:
    """Compare a model with a run, block by block, in constant memory.

    Args:
        valued: The model.
        run: A run that was not fitted.
        gains: Joint effort per logged unit, shape `(n,)`.
        cutoff: Cut-off of the low-pass on both sides [Hz].
        prior: The same model with nominal values, to be scored beside it.
        bands: How sure the model is, for the traces.
        split: What splits the predicted efforts by cause, if they are wanted.
        reference: What the errors in the fixed band are related to; unknown if `None`.

    Raises:
        LogError: The cut-off is too high for the run's rate.
    """
    require_fitting(cutoff, run.rate)
    models = (valued,) if prior is None else (valued, prior)
    reference = EffortReference() if reference is None else reference
    squares, fixed = _Squares(), _Squares()
    thinned, kept = Thinned(MOST_DRAWN), Thinned(MOST_KEPT)
    predictions = _predictions(models, split, gains)
    alone, band = _predictions((valued,), None, gains), band_of(reference, run.rate)
    blocks = blocks_with_channels(run.around(CONTEXT).blocks(), valued.model)
    for _, of_segment in groupby(blocks, key=lambda block: block.segment):
        sure, known = None, np.empty((0, len(gains), 0))
        once, again, *beside = tee(of_segment, 2 if bands is None else 3)
        if bands is not None:
            sure = BandChannels(beside[0], bands, gains, cutoff, run.rate)
        own = _filtered(once, predictions, cutoff, run.rate)
        in_band = _filtered(again, alone, band, run.rate)
        for part, banded in zip_longest(own, in_band):
            if banded is not None:
                (t, moving, *_), efforts = _inside(run, banded)
                if reference.scales:  # the prediction of efforts without estimated scales, too
                    unscaled = efforts[1:] / np.array(reference.scales)[:, None]
                    efforts = np.concatenate([efforts, unscaled])
                fixed.add(efforts, moving)
            if part is None:
                continue
            beside_them = known if sure is None else sure.next(len(part[0][0]))
            beside_them = beside_them[..., _within(run, part[0][0])]
            (t, moving, q, dq), efforts = _inside(run, part)
            compared = efforts[: 1 + len(models)]
            squares.add(compared, moving)
            thinned.add(t, moving, *compared[:2], beside_them)
            if split is not None:
                kept.add(t, moving, q, dq, efforts[0], efforts[-len(PARTS) :])
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
    parts: TorqueParts | None = None
    if split is not None:
        t, moving, q, dq, measured, causes = kept.joined()
        motion = (t, q.T, dq.T, moving.T.astype(bool))
        parts = TorqueParts(*motion, measured.T * gains, causes.swapaxes(1, 2) * gains)
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
        errors=_errors(valued, run, gains, reference, fixed),
        traces=traces_of(thinned, None if bands is None else bands.sigma / np.abs(gains)),
        parts=parts,
    )


def _errors(
    valued: ValuedModel, run: Run, gains: Array, reference: EffortReference, fixed: "_Squares"
) -> BandErrors:
    """Errors in the fixed band, with estimated scales also against the efforts as logged."""
    names = [(c.name, c.effort_unit) for c in valued.model.robot.coordinates]

    def of_rows(rows: list[int], scales: Sequence[float] = ()) -> BandErrors:
        sums, moving = (fixed.all[rows], fixed.samples), (fixed.moving[rows], fixed.samples_moving)
        return band_errors(run, names, gains, reference, sums, moving, scales)

    found = of_rows([0, 1])
    if not reference.scales:
        return found
    return replace(found, as_logged=of_rows([2, 1], reference.scales).joints)


def filtered_efforts(
    valued: ValuedModel, run: Run, gains: Array, cutoff: float
) -> Iterator[tuple[Array, Mask, Array]]:
    """Low-passed efforts of all samples of a run that the errors of a model are computed from.

    Yields:
        Time `(B,)`, where each joint moves `(n, B)`, measured and predicted effort in logged
        units, `(2, n, B)`.
    """
    require_fitting(cutoff, run.rate)
    predicted = _predictions((valued,), None, gains)
    blocks = blocks_with_channels(run.around(CONTEXT).blocks(), valued.model)
    for _, of_segment in groupby(blocks, key=lambda block: block.segment):
        for part in _filtered(of_segment, predicted, cutoff, run.rate):
            (t, moving, _, _), efforts = _inside(run, part)
            if len(t):
                yield t, moving, efforts


def _within(run: Run, t: Array) -> slice:
    """Places of those of some samples that lie between the first and the last motion."""
    start, stop = run.span
    least = 1e-6 / run.rate
    return slice(*np.searchsorted(t, (start - least, stop + least)))


def _inside(run: Run, part: _FilteredStretch) -> _FilteredStretch:
    """Samples of one segment, without those around the motion."""
    signals, efforts = part
    inside = _within(run, signals[0])
    t, moving, q, dq = signals
    return (t[inside], moving[:, inside], q[:, inside], dq[:, inside]), efforts[..., inside]


def _predictions(
    models: Sequence[ValuedModel], split: TorqueSplit | None, gains: Array
) -> Callable[[Block], Array]:
    """Efforts of a block in the logged units, `(k, n, B)`: of each model, and parts, if any."""

    def predicted(block: Block) -> Array:
        efforts = [m.block(block.q, block.dq, block.ddq, block.channels)[None] for m in models]
        parts = [] if split is None else [split.block(block)]
        return np.concatenate([*efforts, *parts]) / gains[:, None]

    return predicted


def _filtered(
    blocks: Iterable[Block], predicted: Callable[[Block], Array], cutoff: float, rate: float
) -> Iterator[_FilteredStretch]:
    """Samples of one segment in parts, with low-passed efforts.

    Yields:
        Time `(B,)`, where each joint moves, its position and velocity, `(n, B)` each; and efforts
        `(1 + k, n, B)`: measured, then those predicted.
    """
    known: list[Signals] = []

    def efforts() -> Iterator[Array]:
        for block in blocks:
            known.append((block.t, block.moving, block.q, block.dq))
            both = np.concatenate((block.effort[None], predicted(block)))
            yield both.reshape(-1, len(block.t))

    for part in apply(low_pass(cutoff, rate), efforts()):
        signals = [np.concatenate(some, axis=-1) for some in zip(*known, strict=True)]
        count, n = part.shape[-1], len(signals[1])
        known[:] = [tuple(x[..., count:] for x in signals)]
        t, moving, q, dq = (x[..., :count] for x in signals)
        yield (t, moving, q, dq), part.reshape(-1, n, count)


class _Squares:
    """Sums of squares per joint: of the error, of the measured effort, of the nominal error.

    Attributes:
        all: Over all samples, shape `(3, n)`; two rows without a nominal model.
        sizes: Sums of the absolute error, of all samples and where the joint moves, shape `(2, n)`.
        samples_moving: The same where each joint moves, shape `(n,)`.
    """

    def __init__(self) -> None:
        self.all = self.moving = self.sizes = np.zeros((2, 1))
        self.samples, self.samples_moving = 0, np.zeros(1)

    def add(self, efforts: Array, moving: Mask) -> None:
        """Measured and predicted efforts, and others that are predicted, `(2 + k, n, B)`."""
        measured, size = efforts[0], np.abs(efforts[0] - efforts[1])
        parts = np.square([measured - efforts[1], measured, *(measured - efforts[2:])])
        if not self.samples:
            self.all = self.moving = np.zeros(parts.shape[:2])
        self.all = self.all + parts.sum(axis=2)
        self.moving = self.moving + np.where(moving, parts, 0.0).sum(axis=2)
        self.sizes = self.sizes + [size.sum(axis=1), np.where(moving, size, 0.0).sum(axis=1)]
        self.samples += moving.shape[1]
        self.samples_moving = self.samples_moving + moving.sum(axis=1)

    def joint(self, j: int, name: str, unit: str) -> JointScore:
        """Errors of one joint."""
        root, count = np.sqrt(self.all[:, j] / self.samples), self.samples_moving[j]
        return JointScore(
            joint=name,
            unit=unit,
            relative_percent=_percent(*self.all[:2, j]),
            relative_percent_moving=_percent(*self.moving[:2, j]) if count else None,
            rmse=float(root[0]),
            rmse_moving=sqrt(self.moving[0, j] / count) if count else None,
            mae=float(self.sizes[0, j] / self.samples),
            mae_moving=float(self.sizes[1, j] / count) if count else None,
            predict_zero=float(root[1]),
            prior_rmse=float(root[2]) if len(root) > 2 else None,
        )


def _percent(error: float, reference: float) -> float:
    """Root of a sum of squared errors relative to another [%].

    A joint that draws no effort at all has no relative error: any error is then infinite.
    """
    if reference == 0.0:
        return 0.0 if error == 0.0 else float("inf")
    return 100.0 * sqrt(error / reference)

"""Scores on a run that was not fitted: how far the predicted effort is from the measured one.

Per joint `100 ‖measured - predicted‖ / ‖measured‖`, from first to last motion, both sides through
one zero-phase fourth-order Butterworth low-pass; once over all samples, once over those where the
joint moves by the log alone, whatever rest speed the model was fitted with. Where contacts touch
whose forces are unknown, predicted efforts have those that fit best: errors are what is left.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import sqrt
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Array, finite_json
from steelyard.base.errors import DataError
from steelyard.estimate.information.gather import Mask, blocks_with_channels
from steelyard.estimate.scores.effort_errors import (
    BandErrors,
    EffortReference,
    Squares,
    band_errors,
    band_of,
    relative_percent,
)
from steelyard.estimate.scores.parts_and_bands_along_run import (
    MOST_DRAWN,
    PARTS,
    Bands,
    Thinned,
    TorqueParts,
    TorqueSplit,
    Traces,
)
from steelyard.model.model import ValuedModel
from steelyard.runs.run import Block, Run
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    ChunkOperation,
    apply,
    low_pass,
    require_fitting,
)

MOST_KEPT = 5000  # samples of a run that are kept at most, with their parts
CONTEXT = 6.0  # of rests beside a motion [s]: an abrupt stop is low-passed with what follows it


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
    """Compare a model with a run that was not fitted, block by block, in constant memory.

    A `prior` is scored beside it, the same model with nominal values; `bands` say how sure the
    model is, for the traces; `split` gives predicted efforts by cause. Both sides go through a
    low-pass of `cutoff` [Hz]; `gains` are joint effort per logged unit, shape `(n,)`.
    """
    models = (valued,) if prior is None else (valued, prior)
    reference = EffortReference() if reference is None else reference
    squares, fixed = Squares(), Squares()
    thinned, kept = Thinned(MOST_DRAWN), Thinned(MOST_KEPT)
    size = np.abs(gains)[:, None]
    for part in low_passed(models, run, gains, cutoff, split, band_of(reference, run.rate), bands):
        in_band = part.in_band
        if reference.scales:  # the prediction of efforts without estimated scales, too
            unscaled = in_band[1:] / np.array(reference.scales)[:, None]
            in_band = np.concatenate([in_band, unscaled])
        fixed.add(in_band, part.counted)
        squares.add(part.efforts[: 1 + len(models)], part.counted)
        sure = np.empty((0, *part.moving.shape))
        if bands is not None:
            half = bands.half_width(part.dq, part.moving, part.std)
            sure = np.stack([part.std / size, np.abs(part.dq), half / size])
        thinned.add(part.t, part.moving, *part.efforts[:2], sure)
        if split is not None:
            causes = part.efforts[-len(PARTS) :]
            # without forces of contacts that are unknown, which the prediction has
            measured = part.efforts[0] - part.efforts[1] + causes.sum(axis=0)
            kept.add(part.t, part.moving, part.q, part.dq, measured, causes)
    if not squares.samples:
        raise no_closed_sample(valued, run)
    parts: TorqueParts | None = None
    if split is not None:
        t, moving, q, dq, measured, causes = kept.joined()
        motion = (t, q.T, dq.T, moving.T)
        parts = TorqueParts(*motion, measured.T * gains, causes.swapaxes(1, 2) * gains)
    coordinates, comparable = valued.model.robot.coordinates, len(set(run.effort_units)) == 1
    return RunScore(
        run=run.name,
        cutoff=cutoff,
        joints=tuple(
            _joint_score(squares, j, coordinate.name, run.effort_units[j])
            for j, coordinate in enumerate(coordinates)
        ),
        pooled_percent=_percent(squares.all[:2].sum(axis=1)) if comparable else None,
        pooled_percent_moving=(
            _percent(squares.moving[:2].sum(axis=1))
            if comparable and squares.samples_moving.any()
            else None
        ),
        errors=band_errors(run, coordinates, gains, reference, fixed),
        traces=thinned.traces(bands is not None),
        parts=parts,
    )


def no_closed_sample(valued: ValuedModel, run: Run) -> DataError:
    """The error of a run without a sample at which the model can be evaluated."""
    wrong = f"the loops of '{valued.model.robot.name}' close at no sample of the run"
    fix = "check the loops' points and links, and the zeros and signs of the positions"
    return DataError(wrong, where=run.name, fix=fix)


@dataclass(frozen=True, eq=False)
class LowPassed:
    """Consecutive samples of a run with low-passed efforts, in logged units."""

    t: Array  # shape `(B,)` [s]
    moving: Mask  # whether each joint moves by the run's rest speed, shape `(n, B)`
    counted: Mask  # whether it moves by that of the log alone, `Run.judged`, likewise
    q: Array  # position, not filtered, shape `(n, B)`; `dq` likewise
    dq: Array
    efforts: Array  # measured, of each model, parts by cause if any, shape `(1 + k, n, B)`
    in_band: Array  # measured and predicted in the fixed band, shape `(2, n, B)`
    std: Array  # of the prediction, in the joint's unit, shape `(n, B)`; empty without bands


class _Beside:
    """Operations on rows of the same channels, beside each other; `None` changes nothing."""

    def __init__(self, *operations: tuple[slice, ChunkOperation | None]) -> None:
        self.operations = operations
        self.halo = max(0 if one is None else one.halo for _, one in operations)

    def __call__(self, extended: Array) -> Array:
        found = []
        for rows, operation in self.operations:
            cut = self.halo - (0 if operation is None else operation.halo)
            inside = extended[rows, cut : extended.shape[1] - cut]
            part = inside if operation is None else operation(inside)
            found.append(part.reshape(-1, part.shape[-1]))
        return np.concatenate(found)


def low_passed(
    models: Sequence[ValuedModel],
    run: Run,
    gains: Array,
    cutoff: float,
    split: TorqueSplit | None = None,
    band: float | None = None,
    bands: Bands | None = None,
) -> Iterator[LowPassed]:
    """Samples that errors are computed from, from first to last motion, in parts of segments.

    Which ones does not depend on how a model was fitted: a rest speed that is set changes none.

    Efforts of models, and of causes if they are split, go through the low-pass of `cutoff`, those
    of the first model also through that of the fixed `band` [Hz].
    """
    require_fitting(cutoff, run.rate)
    n, least, judged = len(gains), 1e-6 / run.rate, run.judged
    span = max(run.span[0], judged.span[0]) - least, min(run.span[1], judged.span[1]) + least
    run = replace(run, span=span)
    first = 1 + 3 * n
    count = (1 + len(models) + (0 if split is None else len(PARTS))) * n
    operations: list[tuple[slice, ChunkOperation | None]] = [
        (slice(0, first), None),
        (slice(first, first + count), low_pass(cutoff, run.rate)),
    ]
    if band is not None:
        operations.append((slice(first, first + 2 * n), low_pass(band, run.rate)))
    if bands is not None:
        operations.append((slice(first + count, None), bands.std_behind(cutoff, run.rate)))

    def rows(block: Block) -> Array:
        efforts = [m.block(block.q, block.dq, block.ddq, block.channels) for m in models]
        causes: Array | list[Array] = [] if split is None else split.block(block)
        predicted = [run.with_forces(block, one / gains[:, None]) for one in efforts]
        predicted += [one / gains[:, None] for one in causes]
        columns = [] if bands is None else [bands.columns(block)]
        plain = (block.t[None], block.moving, block.q, block.dq, block.effort)
        return np.concatenate([*plain, *predicted, *columns])

    edges = (1, 1 + n, 1 + 2 * n, first, first + count, first + count + (2 * n if band else 0))
    blocks = blocks_with_channels(run.around(CONTEXT).blocks(), models[0].model)
    for _, segment in groupby(blocks, key=lambda block: block.segment):
        for part in apply(_Beside(*operations), map(rows, segment)):
            inside = slice(*np.searchsorted(part[0], span))
            t, moving, q, dq, own, fixed, std = np.split(part[:, inside], edges)
            if t.size:
                own, fixed = (x.reshape(-1, n, x.shape[1]) for x in (own, fixed))
                counted = (np.abs(dq) > judged.rest_speed[:, None]) & ~run.unmeasured(t[0])
                yield LowPassed(t[0], moving.astype(bool), counted, q, dq, own, fixed, std)


def _joint_score(squares: Squares, j: int, name: str, unit: str) -> JointScore:
    root, count = np.sqrt(squares.all[:, j] / squares.samples), squares.samples_moving[j]
    return JointScore(
        joint=name,
        unit=unit,
        relative_percent=_percent(squares.all[:2, j]),
        relative_percent_moving=_percent(squares.moving[:2, j]) if count else None,
        rmse=float(root[0]),
        rmse_moving=sqrt(squares.moving[0, j] / count) if count else None,
        mae=float(squares.sizes[0, j] / squares.samples),
        mae_moving=float(squares.sizes[1, j] / count) if count else None,
        predict_zero=float(root[1]),
        prior_rmse=float(root[2]) if len(root) > 2 else None,
    )


def _percent(squares: Array) -> float:
    """Root of a sum of squared errors relative to that of squared efforts [%]."""
    return relative_percent(*np.sqrt(squares).tolist())

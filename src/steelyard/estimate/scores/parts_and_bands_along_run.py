r"""Efforts along a run: by their causes, filtered, and with their 95 % bands.

With values, a model is $\tau = g(q) + C(q, \dot q)\dot q + M(q)\ddot q + \tau_f + \tau_o$: gravity,
Coriolis and centrifugal efforts, inertia of bodies and rotors, friction, and springs with offsets.
The torque is linear in the parameters, so that each part is the torque of the whole model with the
other parameters at zero.

The low-passed prediction of row $j$ is $\bar y_j^T \hat\phi$ with the row's regressor entries
behind the same filter, $\bar y_j$; what is left open of the parameters makes its standard deviation
$\sqrt{\bar y_j^T C \bar y_j}$: the band of the model. Entries as they are have the noise of
accelerations and the jumps of friction where a joint turns round, which the filter takes out of the
prediction. A new measurement scatters by its residual too: $\sqrt{\bar y_j^T C \bar y_j + s_j^2}$.

The residuals behind an estimate have gone through the parallel filter, scores go through another
low-pass. White residuals have variances in the ratio of the filters' noise bandwidths, which $s_j$
follows where a score looks at more; where it looks at less, it is not credited with that, for what
a model lacks is slow.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array, Parameters, frozen
from steelyard.estimate.covariance_and_band_widths import Calibration, covariance_root
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import (
    Layout,
    Regressor,
    base_regressor,
)
from steelyard.estimate.information.gather import Mask
from steelyard.model.model import ValuedModel
from steelyard.model.terms.term import Term
from steelyard.runs.run import Block
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Bank, low_pass
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    noise_bandwidth as low_pass_bandwidth,
)

PARTS = ("gravity", "coriolis", "inertia", "friction", "other")  # order of all arrays


@dataclass(frozen=True, eq=False)
class TorqueParts:
    """Motion, and efforts behind the score's low-pass, of evenly spaced samples of a run."""

    t: Array  # time, shape `(N,)` [s]
    q: Array  # positions, shape `(N, n)` [rad; m]; likewise `dq` [rad/s; m/s]
    dq: Array
    moving: Mask  # whether each joint moves, shape `(N, n)`
    measured: Array  # measured effort, at the joints, shape `(N, n)` [Nm; N]
    parts: Array  # predicted effort by cause, in the order of `PARTS`, shape `(5, N, n)` [Nm; N]

    @classmethod
    def joined(cls, runs: Sequence["TorqueParts"]) -> "TorqueParts":
        """The samples of several runs one after another."""
        signals = zip(*(vars(run).values() for run in runs), strict=True)
        return cls(*(np.concatenate(some, axis=max(-2, -some[0].ndim)) for some in signals))

    @property
    def predicted(self) -> Array:
        """The whole predicted effort, shape `(N, n)` [Nm; N]."""
        return np.asarray(self.parts.sum(axis=0))

    @property
    def residual(self) -> Array:
        """Measured minus predicted effort, shape `(N, n)` [Nm; N]."""
        return self.measured - self.predicted

    @property
    def friction(self) -> Array:
        """Measured effort without all that is not friction in the model, `(N, n)` [Nm; N]."""
        return np.asarray(self.residual + self.parts[PARTS.index("friction")])


class TorqueSplit:
    """Parts of a model's efforts, sample by sample."""

    def __init__(self, valued: ValuedModel) -> None:
        self._masses = only(valued, lambda term: term.cause == "inertia")
        self._friction = only(valued, lambda term: term.cause == "friction")
        self._others = only(valued, lambda term: term.cause not in ("inertia", "friction"))

    def block(self, block: Block) -> Array:
        """Unfiltered parts of the efforts of samples with channels, shape `(5, n, B)` [Nm; N]."""
        q, dq, ddq, still = block.q, block.dq, block.ddq, np.zeros_like(block.dq)
        gravity, bias, rigid = (
            self._masses.block(q, *motion, block.channels)
            for motion in ((still, still), (dq, still), (dq, ddq))
        )
        rest = (m.block(q, dq, ddq, block.channels) for m in (self._friction, self._others))
        return np.stack([gravity, bias - gravity, rigid - bias, *rest])


def only(valued: ValuedModel, chosen: Callable[[Term], bool]) -> ValuedModel:
    """The same model, and so the same machine code, with the values of some terms; others zero."""
    model = valued.model
    kept = [chosen(term) for term in model.terms for _ in term.parameters(model.robot)]
    values = np.where(kept, valued.values.values, 0.0)
    return ValuedModel(model, Parameters(model.names, model.units, values))


TAIL = 1e-6  # what is left of the low-pass's impulse response where it is cut off here


@dataclass(frozen=True, eq=False)
class ModelStd:
    """Outputs of a regressor to standard deviations; an operation with a halo."""

    layout: Layout
    factor: Array  # `F`, with `F @ F.T` the covariance of the columns, shape `(p, k)`
    low_pass: Bank
    step: int  # samples from one that is computed to the next; between them it is interpolated

    @property
    def halo(self) -> int:
        """Samples of context on each side: of the filter, and to the next that is computed."""
        return self.low_pass.halo + self.step

    def __call__(self, extended: Array) -> Array:
        """Outputs `(C, N + 2 halo)` to standard deviations, shape `(n, N)`."""
        count, layout = extended.shape[-1] - 2 * self.halo, self.layout
        points = np.arange(-(-count // self.step) + 1) * self.step
        filtered = self.low_pass(extended[:, self.step :])[0][:, :: self.step][:, : len(points)]
        result = np.empty((len(layout.rows), count))
        for row, (start, seen) in enumerate(zip(layout.starts, layout.sees, strict=True)):
            spread = self.factor[list(seen)].T @ filtered[start : start + len(seen)]
            std = np.sqrt(np.sum(np.square(spread), axis=0))
            result[row] = np.interp(np.arange(count), points, std)
        return result


@dataclass(frozen=True, eq=False)
class Bands:
    """What bands are made from."""

    regressor: Regressor
    factor: Array  # `F`, with `F @ F.T` the covariance of the base parameters, shape `(p, k)`
    sigma: Array  # of residuals behind the score's low-pass, `(n,)` [Nm; N]; NaN without samples
    calibration: Calibration | None = None  # those of noise alone if `None`

    @classmethod
    def of(cls, identified: IdentifiedModel) -> "Bands":
        """The bands of an identified model, for scores with its own cut-off."""
        return cls(
            base_regressor(identified.model),
            frozen(covariance_root(identified.base_covariance)),
            frozen(identified.residual_std(low_pass_bandwidth(identified.cutoffs.score))),
            identified.calibration,
        )

    def half_width(self, speed: Array, moving: Mask, model_std: Array) -> Array:
        """Half-width of the band that holds 95 % of new measurements, in the effort's unit.

        Shape `(n, B)` like all arguments; NaN of a joint whose `sigma` is. A calibration below 1.96
        says that residuals are smaller than their standard deviation; it does not make parameters
        surer, whose errors show in motions unlike those left out.
        """
        noise = np.broadcast_to(self.sigma[:, None], model_std.shape)
        if self.calibration is None:
            return np.asarray(Z95 * np.hypot(model_std, noise))
        factor = self.calibration.factor(speed, moving)
        return np.asarray(np.hypot(np.maximum(factor, Z95) * model_std, factor * noise))

    def std_behind(self, cutoff: float, rate: float) -> ModelStd:
        """Of the outputs behind a score's low-pass [Hz], four samples per period of the cut-off."""
        step = max(1, int(rate / (4.0 * cutoff)))
        layout, taps = self.regressor.layout, low_pass(cutoff, rate, tail=TAIL)
        return ModelStd(layout, self.factor, taps, step)

    def columns(self, block: Block) -> Array:
        """The regressor's outputs, which `ModelStd` takes, shape `(C, B)`."""
        channels = np.empty((0, len(block.t))) if block.channels is None else block.channels
        inputs = (block.q, block.dq, block.ddq, channels, np.zeros_like(block.q))
        return self.regressor.code([np.ascontiguousarray(x) for x in inputs])


MOST_DRAWN = 100_000  # samples of a run that its traces keep at most

Signal = NDArray[np.float64 | np.bool_]
Signals = tuple[Any, ...]  # several of them, equally long


@dataclass(frozen=True, eq=False)
class Traces:
    """Filtered effort along a run, in its logged unit: `t` is `(N,)`, the others `(N, n)`.

    Of a run longer than `MOST_DRAWN` samples, evenly spaced ones.
    """

    t: Array
    measured: Array
    predicted: Array
    moving: Mask
    model_std: Array | None = None  # of the prediction, by what is open of the parameters
    speed: Array | None = None  # size of each joint's velocity [rad/s; m/s]; `None` without bands
    band: Array | None = None  # half-width for 95 % of new samples; NaN of joints without samples

    @property
    def coverage(self) -> Array | None:
        """Share of the measurements in the band per joint, shape `(n,)`; NaN without a band."""
        if self.band is None:
            return None
        inside = np.abs(self.measured - self.predicted) <= self.band
        return np.where(np.isfinite(self.band).all(axis=0), inside.mean(axis=0), np.nan)


class Thinned:
    """Signals of a run of any length: every sample of a short one, every 2nd, 4th... of others."""

    def __init__(self, most: int) -> None:
        self._parts: list[Signals] = []
        self._most, self._step, self._seen = most, 1, 0

    def add(self, *signals: Signal) -> None:
        """Take in the next samples, along the last axis; kept are the multiples of the step."""
        at = slice(-self._seen % self._step, None, self._step)
        self._seen += signals[0].shape[-1]
        self._parts.append(tuple(x[..., at].copy() for x in signals))
        while self._seen > self._step * self._most:
            self._parts = [tuple(x[..., ::2].copy() for x in self.joined())]
            self._step *= 2

    def joined(self) -> Signals:
        """What was kept of each signal."""
        return tuple(np.concatenate(parts, axis=-1) for parts in zip(*self._parts, strict=True))

    def traces(self, banded: bool) -> Traces:
        """Of time, where joints move, efforts measured and predicted, and what bands say."""
        t, moving, measured, predicted, known = self.joined()
        std, speed, band = (x.T for x in known) if banded else (None, None, None)
        return Traces(t, measured.T, predicted.T, moving.T, std, speed, band)

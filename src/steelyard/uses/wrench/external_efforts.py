r"""External efforts along a run: what the model's efforts leave over, and how far it may be off.

By the torque, $\tau_e = M \ddot q + b + \tau_f + \dots - \tau$, or by the momentum, which needs no
accelerations; both behind the same zero-phase low-pass, so that neither lags. Where a joint rests,
its friction lies anywhere in a dead zone: laws without memory then predict none, and efforts are
that uncertain for as long as the low-pass sees the rest.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.effort_uncertainty import EffortUncertainty
from steelyard.estimate.external.effort_to_wrench import ExternalEfforts
from steelyard.estimate.external.observer import momentum_residual
from steelyard.estimate.external.observer_program import Observed
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.identified import IdentifiedModel
from steelyard.estimate.information.gather import blocks_with_channels
from steelyard.estimate.scores.residuals import PARTS, TorqueSplit
from steelyard.model.quantity import Quantity
from steelyard.runs.run import Block, Run
from steelyard.runs.smoothing.filters import noise_bandwidth, zero_phase

ResidualKind = Literal["momentum", "torque"]

FRICTION_PART = PARTS.index("friction")

WHITE_NOISE_SHARE = 0.5
"""Share of the fit's residual variance that is noise. Slow residuals are given all of it too, with
what left-out motion and the dead zone add: on a UR10e on other days most of it is slow."""

LONGEST_STRETCH = 120.0
"""Longest stretch along which the errors of the model's parameters are the same [s]."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of a run without gaps.

    Attributes:
        t: Time from the log's start, shape `(N,)` [s].
    """

    t: Array
    efforts: ExternalEfforts


@dataclass(frozen=True, eq=False)
class EffortSource:
    """What computes external efforts along runs.

    Attributes:
        bandwidth: Of the low-pass [Hz].
    """

    identified: IdentifiedModel
    quantity: Quantity
    residual: ResidualKind
    bandwidth: float

    def stretches(self, run: Run) -> Iterator[Stretch]:
        """Stretches of at most `LONGEST_STRETCH`; samples at twice the bandwidth or faster."""
        uncertainty = self.identified.effort_uncertainty(noise_bandwidth(self.bandwidth))
        every = max(1, int(run.rate / (2.0 * self.bandwidth)))
        blocks = blocks_with_channels(run.blocks(), self.identified.model)
        for _, of_segment in groupby(blocks, key=lambda block: block.segment):
            whole = self._segment(of_segment, run.rate, every, uncertainty)
            count = -(-len(whole.t) * every // int(LONGEST_STRETCH * run.rate + 1))
            for at in np.array_split(np.arange(len(whole.t)), count):
                inside = slice(int(at[0]), int(at[-1]) + 1)
                yield Stretch(whole.t[inside], whole.efforts.part(inside))

    def _segment(
        self, blocks: Iterable[Block], rate: float, every: int, uncertainty: EffortUncertainty
    ) -> Stretch:
        split = TorqueSplit(self.identified.valued)
        full, kept, start = [], [], 0
        for block in blocks:
            observed, speed = self._observed(block), np.abs(block.dq)
            noise = uncertainty.noise(speed, block.moving)
            full.append((*self._parts(block, observed, split), noise))
            at = slice(-start % every, None, every)
            spread = uncertainty.spread(observed.columns[at], speed[:, at], block.moving[:, at])
            kept.append((block.t[at], observed.jacobian[at].copy(), spread))
            start += len(block.t)
        first, driven, noise = (np.concatenate(some) for some in zip(*full, strict=True))
        raw = first - driven
        if self.residual == "momentum":
            raw = momentum_residual(first, driven, rate)
        t, jacobian, spread = (np.concatenate(some) for some in zip(*kept, strict=True))
        noise = np.maximum(noise, zero_phase(noise, self.bandwidth, rate))[::every]
        efforts = ExternalEfforts(
            step=every / rate,
            torque=zero_phase(raw, self.bandwidth, rate)[::every],
            jacobian=jacobian,
            spread=spread,
            slow=noise,
            noise=np.sqrt(WHITE_NOISE_SHARE) * np.minimum(noise, uncertainty.sigma),
            correlation=uncertainty.correlation,
            per_independent=rate / every / (2.0 * noise_bandwidth(self.bandwidth)),
        )
        return Stretch(t, efforts)

    def _parts(self, block: Block, observed: Observed, split: TorqueSplit) -> tuple[Array, Array]:
        """Predicted and measured efforts, or the momentum and what changes it, `(N, n)` each."""
        predicted = split.block(block)
        at_rest = predicted[FRICTION_PART] * ~(
            block.moving | has_memory(self.identified.model.terms)
        )
        effort = (block.effort * self.identified.signals.gains[:, None] + at_rest).T
        if self.residual == "torque":
            return predicted.sum(axis=0).T, effort
        return observed.momentum.copy(), effort + observed.drive

    def _observed(self, block: Block) -> Observed:
        model, values = self.identified.model, self.identified.valued.values.values
        compiled = model.compiled(self.quantity)
        channels = np.empty((0, len(block.t))) if block.channels is None else block.channels
        inputs = (block.q, block.dq, block.ddq, channels, values[compiled.columns])
        entries = compiled.code(inputs, [False, False, False, False, True])
        return Observed.of(entries.T, model.robot.n)

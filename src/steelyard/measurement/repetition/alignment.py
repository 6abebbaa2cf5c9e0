"""Repetitions of one motion, aligned by position between samples; their mean and their variance."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError

ROUNDS = 4
"""Rounds of the alignment."""
FAR = 0.02
"""How far a repetition may be moved in a round, in its own lengths."""
UNLIKE = 0.05
"""Distance from the mean, over the size of the motion, at which a repetition is none."""


@dataclass(frozen=True, eq=False)
class Averaged:
    """The mean over repetitions.

    Attributes:
        mean: Mean channels of one repetition, with context, shape `(C, P + 2 context)`.
        variance: Sample variance of one repetition about the mean, likewise (p2, eq 7).
        starts: Where the repetitions start, in samples of their logs, shape `(R,)`.
        apart: Rms distance of each repetition's positions from the mean, shape `(R,)`.
    """

    mean: Array
    variance: Array
    starts: Array
    apart: Array

    @property
    def count(self) -> int:
        """Number of repetitions."""
        return len(self.starts)


def averaged(
    logs: Sequence[Array], starts: Sequence[Array], length: int, positions: slice, context: int = 0
) -> Averaged:
    r"""Mean and sample variance, $\frac{1}{R - 1} \sum_k (x_k - \bar x)^2$, over repetitions.

    Args:
        logs: Channels of each log, shape `(C, N)`, all at one rate.
        starts: Where the repetitions in each log start, about, in samples.
        length: Samples of a repetition, P.
        positions: Which channels are positions; repetitions are moved until these lie on each
            other.
        context: Samples before and after a repetition that are averaged too. Beyond a log's ends
            its first and last values go on.

    Raises:
        LogError: There are fewer than two repetitions, or one is another motion.
    """
    which = [log for log, places in enumerate(starts) for _ in places]
    if len(which) < 2:
        raise LogError(
            "there are fewer than two whole repetitions of the motion",
            where="repetitions of [processing]",
            fix="record more of them, drop fewer, or leave repetitions out",
        )
    at = np.concatenate(starts).astype(np.float64)
    reader = _Reader(logs)
    for _ in range(ROUNDS):
        drawn = np.array([x[positions] for x in reader.read(which, at, 0, length)])
        at = at + _shifts(drawn, FAR * length)
    _alike(drawn)
    mean = np.zeros((len(logs[0]), length + 2 * context))
    for x in reader.read(which, at, -context, length + context):
        mean += x / len(at)
    inside = slice(context, context + length)
    squares, apart = np.zeros_like(mean), []
    for x in reader.read(which, at, -context, length + context):
        squares += np.square(x - mean)
        apart.append(np.sqrt(np.square((x - mean)[positions, inside]).sum(axis=0).mean()))
    return Averaged(mean, squares / (len(at) - 1), at, np.array(apart))


class _Reader:
    """Logs read at any times, by splines."""

    def __init__(self, logs: Sequence[Array]) -> None:
        from scipy.interpolate import make_interp_spline

        self._ends = [x.shape[1] - 1 for x in logs]
        self._curves = [make_interp_spline(np.arange(x.shape[1]), x, k=3, axis=1) for x in logs]

    def read(self, which: Sequence[int], at: Array, first: int, stop: int) -> Iterator[Array]:
        """Channels `(C, stop - first)` of every repetition, from its start plus `first` on."""
        for log, start in zip(which, at, strict=True):
            places = np.clip(start + np.arange(first, stop), 0.0, self._ends[log])
            yield np.asarray(self._curves[log](places))


def _shifts(q: Array, most: float) -> Array:
    """How much later each repetition `(R, n, P)` must be read to lie on the mean, `(R,)`."""
    mean = q.mean(axis=0)
    slope = np.gradient(mean, axis=1)
    late = -np.einsum("rnp,np->r", q - mean, slope) / max(float(np.square(slope).sum()), 1e-300)
    return np.asarray(np.clip(late - late.mean(), -most, most))


def _alike(q: Array) -> None:
    """Raise if a repetition is not the same motion as the others, `(R, n, P)`."""
    middle = np.median(q, axis=0)
    size = np.sqrt(np.square(middle - middle.mean(axis=1, keepdims=True)).sum(axis=0).mean())
    apart = np.sqrt(np.square(q - middle).sum(axis=1).mean(axis=1))
    worst = int(np.argmax(apart))
    if apart[worst] > UNLIKE * size:
        raise LogError(
            f"repetition {worst + 1} of {len(q)} differs from the others: it deviates by "
            f"{100.0 * apart[worst] / size:.2g} % of the motion's range",
            where="repetitions of [processing]",
            fix="correct the period, cut the log to the repetitions (LOG@5:65s), or drop more at "
            "its start and end",
        )

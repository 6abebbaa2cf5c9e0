"""Samples and information of drawn motions, without a log."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import frozen
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.information import Signature
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples, SampledRun
from steelyard.runs.motion_error_from_noise import MotionError


def motion_of(n: int, count: int, seed: int, still: Sequence[int] = ()) -> np.ndarray:
    """`q, dq, ddq` of independent instants, shape `(3, n, N)`; some joints may rest."""
    motion = np.random.default_rng(seed).normal(size=(3, n, count))
    for joint in still:
        motion[:, joint] = np.array([0.4, 0.0, 0.0])[:, None]
    return motion


def samples_of(
    regressor: Regressor,
    motion: np.ndarray,
    effort: np.ndarray,
    run: str = "run",
    *,
    position: float = 1e-9,
    start: float = 0.0,
    share: float = 1.0,
) -> FilteredSamples:
    """Samples of instants a hundredth of a second apart.

    Args:
        regressor: The columns.
        motion: As it was measured, shape `(3, n, N)`.
        effort: Shape `(n, N)`.
        run: Name of the run.
        position: Standard deviation of the noise of `q`, `dq` and `ddq` alike.
        start: Time of the first [s].
        share: Independent samples per sample.
    """
    n, count = effort.shape
    dense = regressor.dense(*motion)
    at = tuple(np.arange(count) for _ in range(n))
    error = MotionError(
        np.full(n, position),
        np.zeros(n),
        np.broadcast_to(np.eye(3), (n, 3, 3)),
        np.zeros((n, 3, 3)),
    )
    return FilteredSamples(
        layout=regressor.layout,
        signature=Signature("model", regressor.layout.columns, ("Nm",) * n, "none"),
        sources=(SampledRun(run, share, error),),
        source=np.zeros(count, dtype=np.intp),
        t=frozen(start + 0.01 * np.arange(count)),
        q=frozen(motion[0].T),
        dq=frozen(motion[1].T),
        ddq=frozen(motion[2].T),
        channels=np.zeros((count, regressor.model.n_channels)),
        rows=tuple(
            frozen(np.column_stack([dense[row][:, list(seen)], effort[row]]))
            for row, seen in enumerate(regressor.layout.sees)
        ),
        weights=tuple(np.ones(count) for _ in range(n)),
        at=at,
    )

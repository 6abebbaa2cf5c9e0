r"""Whether the scale of an effort drifts along a run: bodies do not, friction does as it warms.

Each effort row of a run is fitted by least squares of its own, with columns $A$ and parameters
$\hat\phi$. Beside them stands $t\,A_b\hat\phi_b$, the torque of bodies and rotors times the time
from the run's middle over its length. What it takes from the squared residual follows from the sums
of windows, as in `mid_log`; its factor is the relative change of the scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.regression.information import Information
from steelyard.terms.register import law_of

WINDOWS = 4
"""Fewest windows of a run."""
SINGULAR = 1e-9
"""Eigenvalue of a normalised Gram matrix, over the largest, that counts as zero."""


@dataclass(frozen=True)
class Drift:
    """The drift of one row's scale.

    Attributes:
        run: The run's name.
        row: Number of the joint.
        change: Of the scale from the run's start to its end, relative.
        std: Its standard deviation.
        explained: Share of the row's squared residual that it explains.
        rise: What it takes from the squared residual, over the noise that is left.
    """

    run: str
    row: int
    change: float
    std: float
    explained: float
    rise: float


def scale_drifts(run: Information, *, friction: bool = False) -> tuple[Drift, ...]:
    """The drift of every row whose bodies, or whose friction, show one.

    Args:
        run: Information of one run, by windows.
        friction: Of friction and offsets instead of bodies and rotors.
    """
    if len(run.windows) < WINDOWS:
        return ()
    middle = np.array([0.5 * (window.start + window.stop) for window in run.windows])
    time = (middle - middle.mean()) / (run.windows[-1].stop - run.windows[0].start)
    found = (_of_row(run, row, time, friction) for row in range(len(run.layout.rows)))
    return tuple(drift for drift in found if drift is not None)


def together(rows: Sequence[Drift]) -> float:
    """Share of the squared residual that they explain, geometric mean over rows, as of a load."""
    left = [np.log(max(1.0 - row.explained, SINGULAR)) for row in rows]
    return 1.0 - float(np.exp(np.mean(left))) if left else 0.0


def _of_row(run: Information, row: int, time: Array, friction: bool) -> Drift | None:
    names = [run.layout.columns[c] for c in run.layout.sees[row]]
    chosen = np.array([law_of(name).drifts() == friction for name in names])
    grams = run.row_grams(row)
    whole, once, twice = (np.tensordot(time**k, grams, 1) for k in (0, 1, 2))
    own = _whitened(whole[:-1, :-1])
    effort = own.T @ whole[:-1, -1]
    torque = np.where(chosen, own @ effort, 0.0)
    left = float(whole[-1, -1] - effort @ effort)
    freedom = float(run.counts[:, row].sum()) - own.shape[1] - 1.0
    shared = own.T @ once[:-1, :-1] @ torque
    most = float(torque @ twice[:-1, :-1] @ torque)
    bend = most - float(shared @ shared)
    slope = float(torque @ once[:-1, -1] - shared @ effort)
    if freedom <= 0.0 or left <= 0.0 or bend <= SINGULAR * most:
        return None
    gain = slope**2 / bend
    noise = max(left - gain, SINGULAR * left) / freedom
    std = float(np.sqrt(noise / bend))
    return Drift(run.windows[0].run, row, slope / bend, std, gain / left, gain / noise)


def _whitened(gram: Array) -> Array:
    """Combinations of columns with unit Gram matrix, shape `(k, rank)`."""
    lengths = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / lengths[:, None] / lengths)
    kept = values > SINGULAR * values.max()
    found: Array = vectors[:, kept] / np.sqrt(values[kept]) / lengths[:, None]
    return found

r"""Changes within a run, from the fit of each effort row: an offset, a load, a drifting scale.

Each effort row of a run is fitted by least squares of its own, from sums per window of time. Around
every border two windows are left out, for the change may lie in either, and columns are added that
are zero before it: a constant, or the ten columns of a load. What they take from the squared
residual follows from the sums alone: with the row's columns $A$, the new ones $P$,
$M = I - A A^+$ and efforts $b$, it is $g^T H^{-1} g$ with $H = P^T M P$ and $g = P^T M b$.

Each effort row of a run is fitted by least squares of its own, with columns $A$ and parameters
$\hat\phi$. Beside them stands $t\,A_b\hat\phi_b$, the torque of bodies and rotors times the time
from the run's middle over its length. What it takes from the squared residual follows from the sums
of windows, as in `mid_log`; its factor is the relative change of the scale.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.model.laws.register import law_of
from steelyard.robot.rigid_body import INERTIAL_NAMES
from steelyard.robot.robot import Robot

SINGULAR_ROW_GRAM = 1e-9
"""Eigenvalue of a normalised Gram matrix, over the largest, that counts as zero."""
LEAST_ROW_FREEDOM = 20.0
"""Degrees of freedom that a row needs."""
NOISE_ROUNDS = 4
"""Iterations of the rows' noise."""


@dataclass(frozen=True, eq=False)
class ChangeWithinRun:
    """One change in a run.

    Attributes:
        run: The run's name.
        time: Middle of the time in which it lies [s].
        within: Half of that time [s].
        row: Number of the joint; -1 for a load.
        value: Step of the offset [effort's unit], or mass of the load [kg].
        std: Its standard deviation.
        explained: Share of the squared residual that it explains: of the row; of a load the
            geometric mean over rows.
        rise: What it takes from the squared residual, over the noise that is left.
    """

    run: str
    time: float
    within: float
    row: int
    value: float
    std: float
    explained: float
    rise: float


@dataclass(frozen=True, eq=False)
class _Row:
    """One row of a run around one border: its own least squares, and the sums after the border.

    Attributes:
        after: Gram matrix of columns and effort after the border, shape `(k + 1, k + 1)`.
        own: Whitened columns of its own fit, shape `(k, rank)`.
        effort: Products of these with the effort, shape `(rank,)`.
        left: Squared residual.
        freedom: Degrees of freedom.
    """

    after: Array
    own: Array
    effort: Array
    left: float
    freedom: float

    def reduced(self, columns: Array) -> tuple[Array, Array]:
        """$H$ and $g$ of combinations of the row's columns, shape `(k, c)`, after the border."""
        shared = self.own.T @ self.after[:-1, :-1] @ columns
        h = columns.T @ self.after[:-1, :-1] @ columns - shared.T @ shared
        return h, columns.T @ self.after[:-1, -1] - shared.T @ self.effort


@dataclass(frozen=True, eq=False)
class _Border:
    """Rows of a run around one border, and when that is."""

    run: str
    time: float
    within: float
    rows: tuple[_Row, ...]


def _borders(run: Information) -> Iterator[_Border]:
    """Every border with a window before and after the two that are left out."""
    grams = [run.row_grams(row) for row in range(len(run.layout.rows))]
    for at in range(2, len(run.windows) - 1):
        used = [*range(at - 1), *range(at + 1, len(run.windows))]
        rows = tuple(
            _row(gram[used].sum(axis=0), gram[at + 1 :].sum(axis=0), run.counts[used, k].sum())
            for k, gram in enumerate(grams)
        )
        start, stop = run.windows[at - 1].start, run.windows[at].stop
        yield _Border(run.windows[at].run, 0.5 * (start + stop), 0.5 * (stop - start), rows)


def _row(whole: Array, after: Array, count: float) -> _Row:
    lengths = np.sqrt(np.maximum(np.diag(whole)[:-1], 1e-300))
    values, vectors = np.linalg.eigh(whole[:-1, :-1] / lengths[:, None] / lengths)
    kept = values > SINGULAR_ROW_GRAM * values.max()
    own = vectors[:, kept] / np.sqrt(values[kept]) / lengths[:, None]
    effort = own.T @ whole[:-1, -1]
    left = float(whole[-1, -1] - effort @ effort)
    return _Row(after, own, effort, max(left, 0.0), float(count - kept.sum()))


def offset_steps(run: Information) -> list[ChangeWithinRun]:
    """The most likely step of each joint's offset, for joints that have one.

    Args:
        run: Information of one run, by windows.
    """
    found: dict[int, ChangeWithinRun] = {}
    places = [_offset_of(run, row) for row in range(len(run.layout.rows))]
    for border in _borders(run):
        for number, (row, place) in enumerate(zip(border.rows, places, strict=True)):
            if place is None or row.freedom < LEAST_ROW_FREEDOM or row.left <= 0.0:
                continue
            change = _step(border, row, number, place)
            if number not in found or change.rise > found[number].rise:
                found[number] = change
    return list(found.values())


def _offset_of(run: Information, row: int) -> int | None:
    """Place of the constant among a row's columns; `None` if it has none of its own."""
    seen = run.layout.sees[row]
    mine = [k for k, c in enumerate(seen) if run.layout.columns[c].startswith("offset.")]
    return mine[0] if len(mine) == 1 else None


def _step(border: _Border, row: _Row, number: int, place: int) -> ChangeWithinRun:
    h, g = row.reduced(np.eye(len(row.own))[:, [place]])
    bend, slope = float(h[0, 0]), float(g[0])
    if bend <= SINGULAR_ROW_GRAM * row.after[place, place]:
        bend, slope = np.inf, 0.0
    gain = slope**2 / bend
    noise = max(row.left - gain, SINGULAR_ROW_GRAM * row.left) / (row.freedom - 1.0)
    return ChangeWithinRun(
        border.run,
        border.time,
        border.within,
        number,
        slope / bend,
        float(np.sqrt(noise / bend)),
        gain / row.left,
        gain / noise,
    )


def load_change(run: Information, robot: Robot, base: BaseMap) -> ChangeWithinRun | None:
    """The most likely time from which on the last link carries more, or less, than before.

    Args:
        run: Information of one run on the base columns, by windows.
        robot: The robot.
        base: Its base parameters.
    """
    columns = _load_columns(run, robot, base)
    own = [columns[list(seen)] for seen in run.layout.sees]
    changes = []
    for border in _borders(run):
        pairs = zip(border.rows, own, strict=True)
        used = [
            (r, c) for r, c in pairs if r.freedom >= LEAST_ROW_FREEDOM and r.left > 0.0 and c.any()
        ]
        if used:
            changes.append(_load(border, used))
    return max(changes, key=lambda c: c.rise, default=None)


def _load(border: _Border, rows: list[tuple[_Row, Array]]) -> ChangeWithinRun:
    """Ten numbers shared by all rows, each row weighed by the noise that a load leaves to it."""
    before = left = np.array([row.left for row, _ in rows])
    freedom = np.array([row.freedom for row, _ in rows])
    parts = [row.reduced(columns) for row, columns in rows]
    for _ in range(NOISE_ROUNDS):
        noise = left / freedom
        h = sum((h / s for (h, _), s in zip(parts, noise, strict=True)), np.zeros((10, 10)))
        g = sum((g / s for (_, g), s in zip(parts, noise, strict=True)), np.zeros(10))
        inverse = np.linalg.pinv(h, rcond=1e-10, hermitian=True)
        ten = inverse @ g
        gained = np.array([2.0 * g @ ten - ten @ h @ ten for h, g in parts])
        left = np.maximum(before - gained, SINGULAR_ROW_GRAM * before)
    return ChangeWithinRun(
        border.run,
        border.time,
        border.within,
        -1,
        float(ten[0]),
        float(np.sqrt(max(inverse[0, 0], 0.0))),
        1.0 - float(np.exp(np.mean(np.log(left / before)))),
        float(np.sum((before - left) * freedom / left)),
    )


def _load_columns(run: Information, robot: Robot, base: BaseMap) -> Array:
    """Ten numbers of the last link to the information's columns, shape `(columns, 10)`.

    Zero where the model has no rigid bodies.
    """
    names = [f"{kind}.{robot.bodies[-1].name}" for kind in INERTIAL_NAMES]
    found = np.zeros((len(run.layout.columns), len(names)))
    if not set(names) <= set(base.names):
        return found
    numbers = [base.names.index(name) for name in names]
    lift, place = base.lift, {name: k for k, name in enumerate(run.layout.columns)}
    for row, name in zip(lift, base.base_names, strict=True):
        if name in place:
            found[place[name]] = row[numbers]
    return found


FEWEST_DRIFT_WINDOWS = 4
"""Fewest windows of a run."""
SINGULAR_DRIFT_GRAM = 1e-9
"""Eigenvalue of a normalised Gram matrix, over the largest, that counts as zero."""


@dataclass(frozen=True)
class ScaleDrift:
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


def scale_drifts(run: Information, *, friction: bool = False) -> tuple[ScaleDrift, ...]:
    """The drift of every row whose bodies, or whose friction, show one.

    Args:
        run: Information of one run, by windows.
        friction: Of friction and offsets instead of bodies and rotors.
    """
    if len(run.windows) < FEWEST_DRIFT_WINDOWS:
        return ()
    middle = np.array([0.5 * (window.start + window.stop) for window in run.windows])
    time = (middle - middle.mean()) / (run.windows[-1].stop - run.windows[0].start)
    found = (_drift_of_row(run, row, time, friction) for row in range(len(run.layout.rows)))
    return tuple(drift for drift in found if drift is not None)


def share_of_drifts(rows: Sequence[ScaleDrift]) -> float:
    """Share of the squared residual that they explain, geometric mean over rows, as of a load."""
    left = [np.log(max(1.0 - row.explained, SINGULAR_DRIFT_GRAM)) for row in rows]
    return 1.0 - float(np.exp(np.mean(left))) if left else 0.0


def _drift_of_row(run: Information, row: int, time: Array, friction: bool) -> ScaleDrift | None:
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
    if freedom <= 0.0 or left <= 0.0 or bend <= SINGULAR_DRIFT_GRAM * most:
        return None
    gain = slope**2 / bend
    noise = max(left - gain, SINGULAR_DRIFT_GRAM * left) / freedom
    std = float(np.sqrt(noise / bend))
    return ScaleDrift(run.windows[0].run, row, slope / bend, std, gain / left, gain / noise)


def _whitened(gram: Array) -> Array:
    """Combinations of columns with unit Gram matrix, shape `(k, rank)`."""
    lengths = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / lengths[:, None] / lengths)
    kept = values > SINGULAR_DRIFT_GRAM * values.max()
    found: Array = vectors[:, kept] / np.sqrt(values[kept]) / lengths[:, None]
    return found

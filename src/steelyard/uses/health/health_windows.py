r"""Friction, offsets and effort scales of a robot over windows of its normal operation.

The rigid bodies of a robot stay what they are. Per joint $j$ and window the model's residual is
explained by relative changes of its own parts,

$$ \tau_j - \hat\tau_j = \delta_c\,\hat\tau_{c,j} + \delta_v\,\hat\tau_{v,j} + \delta_o
   + \delta_s\,\hat\tau_{b,j} , $$

dry friction, friction that grows with speed, offset and bodies (their scale is that of the efforts:
a drive gain, or a payload). The sums of products of a window give all four with their deviations;
what the model lacks shows as scatter between windows, which widens them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.identified import IdentifiedModel
from steelyard.estimate.information.information import Information

HealthQuantity = Literal["dry friction", "viscous friction", "offset", "effort scale"]
QUANTITIES: tuple[HealthQuantity, ...] = (
    "dry friction",
    "viscous friction",
    "offset",
    "effort scale",
)

LEAST_WINDOW = 10.0
"""Least length of a window [s]."""

MOST_WINDOWS_OF_LOG = 32
"""Windows of a log at most, of `LEAST_WINDOW` or more."""

DETERMINED = 1e-8
"""Least eigenvalue of a window's normal matrix, columns of unit length, that is used."""


@dataclass(frozen=True, eq=False)
class Series:
    """A quantity of one joint over windows.

    Attributes:
        unit: `""` for a relative change, else `Nm` or `N`.
        log: Number of the log of each window, rising, shape `(w,)`.
        t: Middle of each window from the log's start, shape `(w,)` [s].
        value: Change from the model, shape `(w,)`.
        std: Its standard deviation by the window's residuals, shape `(w,)`.
        single: The same from a single sample, shape `(w,)`: what residuals that another motion
            explains may change.
        scale: What a change is compared with in `MATTERS`.
        known: Standard deviation of the model's own value.
    """

    joint: str
    quantity: HealthQuantity
    unit: str
    log: Array
    t: Array
    value: Array
    std: Array
    single: Array
    scale: float
    known: float

    def by_log(self) -> Iterator[tuple[int, Array, Array, Array]]:
        """Number of each log, and times, values and standard deviations of its windows."""
        for log in np.unique(self.log):
            mine = self.log == log
            yield int(log), self.t[mine], self.value[mine], self.std[mine]


def series_of(identified: IdentifiedModel, logs: Sequence[Information]) -> tuple[Series, ...]:
    """Changes from the model, per joint, quantity and window; efforts of the logs as logged."""
    gains, units = identified.signals.gains, identified.model.robot.effort_units
    scaled = [log.scaled(gains, units) for log in logs]
    model = identified.model
    groups: dict[str, HealthQuantity] = {}  # what is not in it belongs to bodies
    for term in model.terms:
        for parameter in term.parameters(model.robot):
            if term.cause == "offset":
                groups[parameter.name] = "offset"
            elif term.cause == "friction":
                faster = "s" in parameter.unit
                groups[parameter.name] = "viscous friction" if faster else "dry friction"
    rows = range(len(units))
    return tuple(one for row in rows for one in _of_joint(identified, scaled, groups, row))


def _of_joint(
    identified: IdentifiedModel,
    logs: Sequence[Information],
    groups: Mapping[str, HealthQuantity],
    row: int,
) -> Iterator[Series]:
    layout = logs[0].layout
    seen = [layout.columns[k] for k in layout.sees[row]]
    known = identified.estimate.parameters.as_dict()
    values = np.array([known.get(name, 0.0) for name in seen])
    of = np.array([groups.get(name, "effort scale") for name in seen])
    parts = np.array([np.where(of == q, 1.0 if q == "offset" else values, 0.0) for q in QUANTITIES])
    transform = np.column_stack([*np.pad(parts, ((0, 0), (0, 1))), np.append(-values, 1.0)])
    grams = np.concatenate([log.row_grams(row) for log in logs])
    counts = np.concatenate([log.counts[:, row] for log in logs])
    small = np.einsum("ki,wkl,lj->wij", transform, grams, transform)
    total = small.sum(axis=0)
    used = [k for k in range(len(QUANTITIES)) if total[k, k] > 0.0]
    chosen = np.ix_([*used, -1], [*used, -1])
    solved = [_solved(gram[chosen], n) for gram, n in zip(small, counts, strict=True)]
    kept = [k for k, one in enumerate(solved) if one is not None]
    if not kept:
        return
    changes, deviations = np.swapaxes([one for one in solved if one is not None], 0, 1)
    log = np.repeat(np.arange(len(logs), dtype=np.float64), [len(one.windows) for one in logs])
    middle = np.array([0.5 * (w.start + w.stop) for one in logs for w in one.windows])
    coordinate = identified.model.robot.coordinates[row]
    friction = float(np.sqrt(sum(total[k, k] for k in (0, 1)) / max(counts.sum(), 1.0)))
    stds = _relative_std(identified, seen, parts)
    for place, k in enumerate(used):
        offset, std = QUANTITIES[k] == "offset", deviations[:, place].copy()
        yield Series(
            joint=coordinate.name,
            quantity=QUANTITIES[k],
            unit=coordinate.effort_unit if offset else "",
            log=log[kept],
            t=middle[kept],
            value=changes[:, place].copy(),
            std=std,
            single=std * np.sqrt(counts[kept]),
            scale=friction if offset else 1.0,
            known=stds[k],
        )


def _solved(gram: Array, count: float) -> tuple[Array, Array] | None:
    """Changes and their standard deviations; `None` of a window that does not show them all."""
    matrix, vector, square = gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1])
    lengths = np.sqrt(np.diag(matrix))
    if count <= len(lengths) + 1 or not np.all(lengths > 0.0):
        return None
    unit = matrix / lengths[:, None] / lengths
    if np.linalg.eigvalsh(unit)[0] < DETERMINED:
        return None
    inverse = np.linalg.inv(unit) / lengths[:, None] / lengths
    values = inverse @ vector
    rest = max(square - float(values @ vector), 1e-12 * square)
    return values, np.sqrt(np.diag(inverse) * rest / (count - len(lengths)))


def _relative_std(identified: IdentifiedModel, seen: Sequence[str], parts: Array) -> list[float]:
    """Standard deviation of the model's own value of each quantity, along its parameters."""
    place = {name: k for k, name in enumerate(identified.estimate.parameters.names)}
    mine = [k for k, name in enumerate(seen) if name in place]
    at = [place[seen[k]] for k in mine]
    covariance = identified.estimate.covariance[np.ix_(at, at)]
    found = []
    for part in parts[:, mine]:
        size = float(part @ part)
        found.append(float(np.sqrt(part @ covariance @ part)) / size if size else 0.0)
    return found

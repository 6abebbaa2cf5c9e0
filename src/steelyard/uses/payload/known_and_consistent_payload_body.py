r"""A payload as a physically consistent body, from the ten numbers of an unconstrained estimate.

With the unconstrained $\hat\phi$ and its covariance $C$

$$ \min_\phi \|\phi - \hat\phi\|^2_{C^{-1}} + \sum_k r_k(\phi)^2 \quad
   \text{subject to a pseudo-inertia } J(\phi) \succ 0 $$

where the rows $r_k$ are what is known: mass, centre of mass, and the second moments of a shape
about the centre, linear in $\phi$ for a given centre. A shape says nothing about where the body is.
If nothing is known and $\hat\phi$ is physically consistent, it is the result; else a weak penalty
keeps what the data hardly determine away from the edge of consistent bodies.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from typing_extensions import Self

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    BASIS,
    ENTRIES,
    ORDER,
    Block,
    Conic,
    Entropic,
    solved,
    ten_map,
)
from steelyard.estimate.payload.runs_with_payload import SEEN, covariance_of
from steelyard.estimate.prior.body_priors import of_spread
from steelyard.robot.inertia_and_placement import Inertia

DENSITY = 1000.0  # of the ball whose second moments replace smaller ones where no body fits [kg/m³]
LARGEST = 25.0  # second moment per mass that stands in for a shape [m²]: a rod of 17 m
LOOSE = 0.05  # weight of what stands in: moments 20 times as large cost one standard deviation
STATED = 0.3  # relative standard deviation of a shape's moments: density is rarely uniform
KNOWN_MASS, KNOWN_COM = 1e-3, 1e-3  # standard deviations: of a mass relative, of a centre [m]
TOO_FAR = 3.0  # standard deviations beyond which the data contradict what is known
SHARPEST = 1e4  # inverse of the least standard deviation that counts, in sizes of the shape
UNSEEN = 1e-12  # relative size below which a number is rounding

ROUNDS = 10
CONVERGED = 1e-5  # change of the centre [m] at which its second moments have converged
FORM = Entropic()  # keeps bodies possible, and what is hardly determined near the stand-in

Vector = tuple[float, ...]

SOLIDS = {
    "box": ("a box of {:g} x {:g} x {:g} m", (12.0, 12.0, 12.0)),
    "cylinder": ("a cylinder of {:g} m diameter and {:g} m length along z", (16.0, 16.0, 12.0)),
    "sphere": ("a sphere of {:g} m diameter", (20.0, 20.0, 20.0)),
}
"""Solids in words, and squared length over second moment per mass along x, y and z."""


@dataclass(frozen=True)
class SolidShape:
    """A solid of uniform density along the axes of the payload's frame, wherever its centre is."""

    words: str
    moments: Vector  # second moments about the centre per mass, along x, y and z [m²]

    @classmethod
    def of(cls, kind: Literal["box", "cylinder", "sphere"], lengths: Sequence[float]) -> Self:
        """A box with edges of these lengths, a cylinder along z, or a ball of this diameter [m]."""
        if not all(np.isfinite(x) and x > 0.0 for x in lengths):
            shown = ", ".join(f"{x:g}" for x in lengths)
            fix = "give lengths above zero, in metres"
            raise _refused(f"the dimensions of the {kind} are {shown}", fix)
        words, shares = SOLIDS[kind]
        sides = lengths if kind == "box" else (lengths[0], lengths[0], lengths[-1])
        moments = tuple(x**2 / share for x, share in zip(sides, shares, strict=True))
        return cls(words.format(*lengths), moments)


@dataclass(frozen=True)
class PayloadKnowledge:
    """What is known of a payload beside the logs."""

    mass: float | None = None  # [kg]
    com: Vector | None = None  # centre of mass in the payload's frame [m]
    shape: SolidShape | None = None

    def __post_init__(self) -> None:
        if self.mass is not None and not 0.0 < self.mass < np.inf:
            raise _refused(f"the known mass is {self.mass:g} kg", "give a mass above zero, in kg")
        if self.com is not None and not (len(self.com) == 3 and np.isfinite(self.com).all()):
            raise _refused(
                "the known centre of mass is not three numbers",
                "give x, y and z in metres, in the frame of the payload",
            )

    @property
    def words(self) -> tuple[str, ...]:
        """What is known, for people to read."""
        found = []
        if self.mass is not None:
            found.append(f"mass {self.mass:g} kg (± {100.0 * KNOWN_MASS:g} %)")
        if self.com is not None:
            found.append(f"centre ({', '.join(f'{x:g}' for x in self.com)}) m (± 1 mm)")
        if self.shape is not None:
            found.append(f"shape: {self.shape.words}, second moments within {100.0 * STATED:g} %")
        return tuple(found)


@dataclass(frozen=True, eq=False)
class ConsistentBody:
    """The ten numbers of a body, their covariance, and the rise of the squares by the constraints.

    Rows of the covariance of what nothing determines are not numbers; it counts what is known, and
    physical constraints do not narrow it.
    """

    ten: Array
    covariance: Array
    chi_squared: float


def consistent_body(
    free: Array, information: Array, by_data: Array, widening: Array, known: PayloadKnowledge
) -> ConsistentBody:
    """The consistent body that agrees best with an unconstrained estimate and what is known.

    `free` are the unconstrained ten numbers, zero along what the data do not determine;
    `information` is what the data say of them, as if there was noise alone, `by_data` their
    covariance, no numbers in rows of what the data do not see, and `widening` the part of it that
    model and gains add to noise, shape `(10, 10)` each.
    """
    mass, centre = _start(free, by_data, known)
    spread = _spread(free, mass, centre) if known.shape is None else np.diag(known.shape.moments)
    for _ in range(ROUNDS):
        moved = np.array([Inertia.from_ten(e).moved(np.eye(3), centre).ten for e in np.eye(10)]).T
        scale = np.asarray(moved @ ten_map(of_spread(mass, np.zeros(3), mass * spread)))
        matrix, vector = _equations(free, information, widening, scale)
        rows, values = _known_rows(known, mass, scale)
        rows = np.hstack([rows, np.zeros((len(rows), matrix.shape[1] - 10))])
        matrix, vector = np.vstack([matrix, rows]), np.concatenate([vector, values])
        u, rise = _optimum(matrix, vector)
        ten = scale @ u
        before, centre = centre, ten[1:4] / ten[0]
        if known.com is not None or np.abs(centre - before).max() < CONVERGED:
            break
    if not known.words:
        return ConsistentBody(ten, by_data, rise)
    matrix[:, :10] = np.linalg.solve(scale.T, matrix[:, :10].T).T
    return ConsistentBody(ten, covariance_of(matrix.T @ matrix, range(10)), rise)


def refuse_contradiction(free: Array, by_data: Array, known: PayloadKnowledge) -> None:
    """What is known must not contradict the data, by more than `TOO_FAR` standard deviations."""
    std = float(np.sqrt(by_data[0, 0]))
    if known.mass is not None and abs(free[0] - known.mass) > TOO_FAR * std:
        raise _refused(
            f"the data contradict the known mass of {known.mass:g} kg: without it they give "
            f"{free[0]:.3g} ± {Z95 * std:.2g} kg",
            "correct the mass, the drive gains or their uncertainty, or leave the mass out",
        )
    for axis, at in enumerate(known.com or ()):
        row = np.eye(10)[1 + axis] - at * np.eye(10)[0]
        some = np.ix_((0, 1 + axis), (0, 1 + axis))
        std = float(np.sqrt(row[[0, 1 + axis]] @ by_data[some] @ row[[0, 1 + axis]]))
        if abs(row @ free) > TOO_FAR * std + KNOWN_COM * abs(free[0]):
            raise _refused(
                f"the data contradict the known centre of mass: {'xyz'[axis]} is given as {at:g} "
                f"m, the data give {free[1 + axis] / free[0]:.3g} m",
                "give the centre in the frame of the payload (--frame), or leave it out",
            )


def _start(free: Array, by_data: Array, known: PayloadKnowledge) -> tuple[float, Array]:
    """A mass to scale with, and a first centre."""
    width = Z95 * float(np.sqrt(np.nan_to_num(by_data[0, 0], nan=1.0)))
    mass = max(float(free[0]), width, 1e-3) if known.mass is None else known.mass
    if known.com is not None:
        return mass, np.array(known.com)
    seen = float(free[0]) > width and not np.isnan(np.diag(by_data)[:4]).any()
    return mass, free[1:4] / free[0] if seen else np.zeros(3)


def _spread(free: Array, mass: float, centre: Array) -> Array:
    """Second moments per mass that stand in for a shape, shape `(3, 3)` [m²].

    They are those of the unconstrained estimate, along every axis at least those of a ball and at
    most `LARGEST`: data that see little of the inertia leave it anywhere.
    """
    about = Inertia.from_ten(free).moved(np.eye(3), -centre).pseudo[:3, :3] / mass
    radius = np.cbrt(0.75 * mass / (np.pi * DENSITY))
    values, vectors = np.linalg.eigh(about)
    return np.asarray((vectors * np.clip(values, radius**2 / 5.0, LARGEST)) @ vectors.T)


def _equations(
    free: Array, information: Array, widening: Array, scale: Array
) -> tuple[Array, Array]:
    """What the data say, in standard deviations, over the entries of `X` and errors of the model.

    The latter, which widen the covariance, are unknowns of unit variance behind those entries.
    """
    scaled = scale.T @ information @ scale
    size = np.sqrt(np.maximum(np.diag(scaled), 0.0))
    size = np.maximum(size, max(UNSEEN * size.max(), 1e-300))
    values, vectors = np.linalg.eigh(scaled / size[:, None] / size)
    kept = values > SEEN
    root = np.sqrt(values[kept])[:, None] * vectors[:, kept].T * size
    _, sizes, turned = np.linalg.svd(root, full_matrices=False)
    root = np.minimum(sizes, SHARPEST)[:, None] * turned
    inner = np.linalg.solve(scale, np.linalg.solve(scale, widening).T)
    variances, axes = np.linalg.eigh(0.5 * (inner + inner.T))
    some = variances > UNSEEN * variances.max(initial=1e-300)
    errors = axes[:, some] * np.sqrt(variances[some])
    count = errors.shape[1]
    matrix = np.block([[root, root @ errors], [np.zeros((count, 10)), np.eye(count)]])
    return matrix, np.concatenate([root @ np.linalg.solve(scale, free), np.zeros(count)])


def _known_rows(known: PayloadKnowledge, mass: float, scale: Array) -> tuple[Array, Array]:
    """What is known over the entries of `X`, in standard deviations, and its values."""
    rows, values = [np.zeros((0, 10))], [np.zeros(0)]
    if known.shape is not None:  # second moments over those of the shape and the mass, less one
        inner = [(k, i == j) for k, (i, j) in enumerate(ENTRIES) if j < ORDER - 1]
        shape = np.zeros((6, 10))
        for row, (k, diagonal) in zip(shape, inner, strict=True):
            row[k], row[-1] = (1.0, -1.0) if diagonal else (np.sqrt(2.0), 0.0)
        rows.append(shape / STATED)
        values.append(np.zeros(6))
    if known.mass is not None:
        rows.append(scale[:1] / (KNOWN_MASS * known.mass))
        values.append(np.array([1.0 / KNOWN_MASS]))
    if known.com is not None:
        rows.append((scale[1:4] - np.outer(known.com, scale[0])) / (KNOWN_COM * mass))
        values.append(np.zeros(3))
    return np.vstack(rows), np.concatenate(values)


def _optimum(matrix: Array, vector: Array) -> tuple[Array, float]:
    """Least squares with `X` above a margin: its entries `(10,)`, and the squares that costs.

    Where the unconstrained optimum is no body, a shape stands in for what is hardly determined.
    """
    u, count = np.linalg.lstsq(matrix, vector)[0], matrix.shape[1]
    if np.linalg.eigvalsh(np.tensordot(u[:10], BASIS, axes=1))[0] >= FORM.margin:
        return np.asarray(u[:10], dtype=np.float64), 0.0
    unit = float(np.linalg.norm(matrix, 2))
    part, rows = FORM.part(LOOSE / unit**2), len(vector)
    between = np.zeros(count - 10)
    behind = np.concatenate([np.arange(10), count + rows + np.arange(len(part.linear) - 10)])
    equation = np.hstack([matrix / unit, -np.eye(rows)])
    program = Conic(
        np.concatenate([part.square[:10], between, np.ones(rows), part.square[10:]]),
        np.concatenate([part.linear[:10], between, np.zeros(rows), part.linear[10:]]),
        (
            Block("zero", np.arange(count + rows), equation, vector / unit),
            *(replace(block, columns=behind[block.columns]) for block in part.blocks),
        ),
    )
    best = solved(program, "the payload as a physically consistent body")[:count]
    rise = np.square(matrix @ best - vector).sum() - np.square(matrix @ u - vector).sum()
    return np.asarray(best[:10]), max(0.0, float(rise))


def _refused(wrong: str, fix: str) -> DataError:
    return DataError(wrong, where="what is known of the payload", fix=fix)

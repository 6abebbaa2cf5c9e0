"""Which pairs can be kept apart at all, found from random postures."""

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.excitation.collision.pairs import Pair
from steelyard.excitation.shapes.shapes import Shape
from steelyard.excitation.shapes.solids import Hull
from steelyard.robot.robot import Robot

POSTURES = 200
"""Random postures that decide which pairs can be kept apart at all."""

_WHERE = "collision of the robot with its cell"


def random_postures(robot: Robot) -> Array:
    """`POSTURES` positions within the joints' limits, or within one turn or a metre."""
    rng = np.random.default_rng(0)
    bounds = np.empty((2, robot.n))
    for k, joint in enumerate(robot.coordinates):
        span = np.pi if joint.kind == "revolute" else 1.0
        bounds[0, k] = joint.limits.lower if np.isfinite(joint.limits.lower) else -span
        bounds[1, k] = joint.limits.upper if np.isfinite(joint.limits.upper) else span
    return rng.uniform(bounds.min(axis=0), bounds.max(axis=0), (POSTURES, robot.n))


def separable(
    shapes: Sequence[Shape], pairs: Sequence[Pair], farthest: Array, margin: float
) -> tuple[tuple[Pair, ...], Array, tuple[str, ...]]:
    """The pairs that can be kept apart, and how far.

    Links on the fixed base make no pairs with the cell, so whatever does can move.

    Args:
        shapes: All shapes.
        pairs: Pairs of them.
        farthest: The greatest distance of each pair that was seen, shape `(k,)` [m].
        margin: Distance to keep [m].

    Returns:
        Pairs, distance to keep of each, shape `(k,)` [m], and notes on those of the robot itself
        that cannot keep the margin.

    Raises:
        ModelError: The cell overlaps a link in every posture, or is never `margin` away.
    """
    close = [(pair, float(d)) for pair, d in zip(pairs, farthest, strict=True) if d < margin]
    _refuse(shapes, close, margin)
    near = {pair.names: distance for pair, distance in close}
    kept = tuple(pair for pair in pairs if near.get(pair.names, 0.0) >= 0.0)
    wanted = np.array([0.0 if pair.names in near else margin for pair in kept])
    stuck = [f"{p.first} and {p.second}" for p, d in close if d < 0.0]
    touching = [f"{p.first} and {p.second} (at most {_down(d)} m)" for p, d in close if d >= 0.0]
    notes = []
    if stuck:
        how = "overlap in every tested posture, so they are left out"
        notes.append(f"these pairs {how}: {', '.join(stuck)}")
    if touching:
        how = f"are never {margin:g} m apart, so only contact is avoided"
        notes.append(f"these pairs {how}: {', '.join(touching)}")
    return kept, wanted, tuple(notes)


def _refuse(shapes: Sequence[Shape], close: Sequence[tuple[Pair, float]], margin: float) -> None:
    """Pairs with the cell, if they cannot be kept apart."""
    cell = []
    for pair, distance in close:
        for name, k in zip((pair.first, pair.second), pair.shapes[0], strict=True):
            if shapes[k].origin == "world":
                cell.append((pair, distance, name))
    inside = [(pair, name) for pair, distance, name in cell if distance < 0.0]
    if inside:
        pair, name = inside[0]
        own = {way[pair.second == name] for way in pair.shapes}
        hull = any(isinstance(shapes[k].solid, Hull) for k in own)
        other = ", ".join(f"'{x}'" for p, n in inside if n == name for x in p.names - {n})
        first = "split it into convex pieces" if hull else f"place '{name}' elsewhere"
        raise ModelError(
            f"'{name}' overlaps {other} in every posture tried"
            + (": a mesh counts as its convex hull" if hull else ""),
            where=_WHERE,
            fix=f"{first}, or name the pair in ignore: [{pair.first!r}, {pair.second!r}]",
        )
    if cell:
        pair, distance, _ = min(cell, key=lambda one: one[1])
        raise ModelError(
            f"'{pair.first}' and '{pair.second}' are never {margin:g} m apart: the largest "
            f"possible margin in {POSTURES} random postures is {_down(distance)} m",
            where=_WHERE,
            fix=f"give a margin of {_down(distance)} m or less, move the object in the cell, or "
            "name the pair in ignore",
        )


def _down(distance: float) -> str:
    """A distance rounded down to a tenth of a millimetre."""
    return f"{np.floor(max(distance, 0.0) * 1e4) / 1e4:g}"

"""Floor, planes and boxes to keep out of, for all that a robot moves."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.collision.collision import ROOM, Clearance
from steelyard.excitation.collision.pairs import Pair
from steelyard.excitation.collision.scene import Scene
from steelyard.excitation.collision.separable import random_postures
from steelyard.excitation.collision.whole_robot import WholeRobot
from steelyard.excitation.shapes.shapes import Shape
from steelyard.excitation.uncovered import Gap
from steelyard.robot.robot import Robot

RESERVE = 5e-5
"""Kept beyond every wall [m], for controllers that interpolate between points of a file."""

NAME = "floor, planes and boxes"
"""Of the constraint."""

_POSTURES = 24
_SAME = 1e-9
_NEAR = 1e-3
_INSIDE = 1e-6


@dataclass(frozen=True, eq=False)
class Room(Clearance):
    """A `Clearance` of things that move from walls that do not.

    Attributes:
        walls: Names of the walls; from what else stands there a distance is kept.
    """

    walls: frozenset[str] = frozenset()

    @property
    def labels(self) -> tuple[str, ...]:
        """What each margin is."""
        own = super().labels
        return tuple(
            f"'{pair.first}' clear of '{pair.second}'" if pair.second in self.walls else label
            for pair, label in zip(self.pairs, own, strict=True)
        )

    @property
    def how(self) -> str:
        """How it is proven, in one sentence."""
        return (
            "distances of convex shapes with bounds of their rate of change, over time intervals; "
            f"{1e3 * RESERVE:g} mm are reserved at every boundary"
        )


def room_of(
    robot: Robot,
    whole: WholeRobot,
    walls: Sequence[Shape],
    cell: Sequence[Shape] = (),
    margin: float = 0.0,
    aside: Collection[str] = (),
) -> tuple[Room | None, tuple[str, ...]]:
    """All that moves against walls, and what it carries against the cell.

    Args:
        robot: The robot.
        whole: What it moves.
        walls: Half-spaces and boxes.
        cell: What stands in the cell; links are kept from it elsewhere.
        margin: Distance to keep from the cell [m].
        aside: What is carried that is kept from the cell elsewhere, too.

    Returns:
        The constraint, or `None` if nothing can be kept from anything; and what the user should
        know, one sentence each.
    """
    shapes = (*whole.links, *whole.carried, *walls, *cell)
    first = len(whole.links) + len(whole.carried)
    standing = range(first + len(walls), len(shapes))
    loose = [k for k in range(len(whole.links), first) if shapes[k].name not in aside]
    pairs = _pairs(shapes, range(first), range(first, standing.start))
    pairs += _pairs(shapes, loose, standing)
    if not pairs:
        return None, whole.notes
    names = frozenset(wall.name for wall in walls)
    kept, notes = _that_change(robot, shapes, pairs)
    notes = (*whole.notes, *notes)
    if walls and whole.still:
        still = ", ".join(whole.still)
        notes += (f"the base does not move, so workspace limits ignore its links: {still}",)
    if not kept:
        return None, notes
    wanted = np.array([RESERVE if pair.second in names else margin for pair in kept])
    things = len({pair.first for pair in kept})
    scope = f"{whole.scope}, tool and loads: {things} moving bodies"
    return _built(robot, shapes, kept, wanted, names, scope), notes


def _pairs(shapes: Sequence[Shape], movers: Sequence[int], stands: Sequence[int]) -> list[Pair]:
    """Every named thing with every named wall."""
    found: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for i in movers:
        for j in stands:
            found.setdefault((shapes[i].name, shapes[j].name), []).append((i, j))
    return [Pair(first, second, tuple(ways)) for (first, second), ways in found.items()]


def _built(
    robot: Robot,
    shapes: tuple[Shape, ...],
    pairs: tuple[Pair, ...],
    wanted: Array,
    walls: frozenset[str],
    scope: str = "",
) -> Room:
    ways = [way for pair in pairs for way in pair.shapes]
    activation_distance = np.full(len(pairs), ROOM)
    scene = Scene(robot, shapes, ways)
    return Room(
        robot, scene, pairs, wanted, activation_distance, name=NAME, scope=scope, walls=walls
    )


def _that_change(
    robot: Robot, shapes: tuple[Shape, ...], pairs: Sequence[Pair]
) -> tuple[tuple[Pair, ...], tuple[str, ...]]:
    """Pairs whose distance the joints change, or that are well apart; and notes on the others."""
    every = _built(robot, shapes, tuple(pairs), np.zeros(len(pairs)), frozenset())
    seen = every.distances(random_postures(robot)[:_POSTURES])
    same, least = np.ptp(seen, axis=0) < _SAME, seen.min(axis=0)
    inside = [(p, d) for p, d, s in zip(pairs, least, same, strict=True) if s and d < -_INSIDE]
    close = same & (least < _NEAR)
    touching = [p for p, d, c in zip(pairs, least, close, strict=True) if c and d >= -_INSIDE]
    notes = list[str]()
    if inside:
        names = ", ".join(f"{p.first} in {p.second} by {-1e3 * d:.3g} mm" for p, d in inside)
        notes.append(Gap(f"outside the workspace limits in every posture, so left out: {names}"))
    if touching:
        names = ", ".join(f"{p.first} and {p.second}" for p in touching)
        notes.append(f"in contact in every posture, so left out: {names}")
    return tuple(p for p, c in zip(pairs, close, strict=True) if not c), tuple(notes)

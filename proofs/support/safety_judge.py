"""What a motion keeps, found anew: Pinocchio's kinematics and torques, coal's distances."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from proofs.support.safety_motion import derivative, fine_times
from proofs.support.safety_robots import Arm

COARSE = 1500
"""Times at which all distances are found; about the least of them many more."""


@dataclass(frozen=True)
class Rules:
    """What must be kept, in plain numbers; shares and margins are already taken off.

    Attributes:
        lower: Least positions.
        upper: Greatest positions.
        velocity: Greatest speeds.
        acceleration: Greatest accelerations.
        jerk: Greatest jerks, if any.
        effort: Greatest efforts, infinite for any.
        power: Greatest powers, infinite for any, the last that of all joints together.
        frame: Of the tool.
        point: Of the tool in it [m].
        radius: Of the ball there [m].
        box: Per axis least and greatest, or `None`.
        planes: Unit normals and levels.
        keep_out: Lower and upper corners.
        apart: Distance that things keep [m]; `None` if nothing is looked at.
        bodies: Whether the robot keeps clear of itself.
        ignore: Pairs that may touch.
        loads: Mass, place and frame of each.
        friction: Viscous, Coulomb, offset of every joint.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray | None = None
    effort: np.ndarray | None = None
    power: np.ndarray | None = None
    frame: str = "tool"
    point: tuple[float, ...] = (0.0, 0.0, 0.0)
    radius: float = 0.0
    box: tuple[tuple[float, float] | None, ...] = (None, None, None)
    planes: tuple[tuple[np.ndarray, float], ...] = ()
    keep_out: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    apart: float | None = None
    bodies: bool = True
    ignore: tuple[tuple[str, str], ...] = ()
    loads: tuple[tuple[float, tuple[float, ...], str], ...] = ()
    friction: np.ndarray | None = None


@dataclass(frozen=True)
class Margin:
    """One margin at its least.

    Attributes:
        value: Least of all samples, in the constraint's unit.
        size: What it is counted in: half a range, a limit, or the way to the margin.
    """

    value: float
    size: float


@dataclass
class Judge:
    """A robot in its cell.

    Attributes:
        model: Pinocchio's robot.
        solids: Shapes of robot and cell.
        pairs: Names of two things to numbers of their shapes.
        loaded: The robot without and with each load.
    """

    arm: Arm
    urdf: Path
    cell: Path | None = None
    model: Any = field(init=False)
    solids: Any = field(init=False)
    pairs: dict[tuple[str, str], list[int]] = field(init=False)

    def __post_init__(self) -> None:
        self.model = pin.buildModelFromUrdf(str(self.urdf))
        self.solids = pin.buildGeomFromUrdf(self.model, str(self.urdf), pin.COLLISION)
        names = [re.sub(r"_\d+$", "", solid.name) for solid in self.solids.geometryObjects]
        bodies = [solid.parentJoint for solid in self.solids.geometryObjects]
        for name, solid in self._things():
            self.solids.addGeometryObject(solid)
            names.append(name)
            bodies.append(-1)
        self.pairs = {}
        for j, second in enumerate(names):
            for i, first in enumerate(names[:j]):
                if self._may_meet(first, second, bodies[i], bodies[j]):
                    self.pairs.setdefault((first, second), []).append(
                        len(self.solids.collisionPairs)
                    )
                    self.solids.addCollisionPair(pin.CollisionPair(i, j))

    def _things(self) -> list[tuple[str, Any]]:
        """What stands in the cell."""
        if self.cell is None:
            return []
        world = pin.buildModelFromUrdf(str(self.cell))
        found = pin.buildGeomFromUrdf(world, str(self.cell), pin.COLLISION).geometryObjects
        return [(re.sub(r"_\d+$", "", solid.name), solid) for solid in found]

    def _may_meet(self, first: str, second: str, i: int, j: int) -> bool:
        """Two things that move against each other and are not neighbours on the arm."""
        if -1 in (i, j):
            return not (i == j or "base" in (first, second))
        between = "tool" in (first, second) and bool(self.arm.links[-1].parts)
        return i != j and (abs(i - j) > 1 or between)

    def effort(
        self, rules: Rules, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray
    ) -> list[np.ndarray]:
        """Efforts without the friction that turns, `(N, n)` each.

        Without load, and with each load as a point and as a hollow ball of as much water.
        """
        found = []
        for mass, inertia, place, name in ((0.0, 0.0, np.zeros(3), rules.frame), *_cases(rules)):
            model = self.model.copy()
            frame = model.frames[model.getFrameId(name)]
            at = pin.SE3(np.eye(3), frame.placement.act(np.array(place)))
            body = pin.Inertia(mass, np.zeros(3), inertia * np.eye(3))
            model.appendBodyToJoint(frame.parentJoint, body, at)
            data = model.createData()
            rows = [pin.rnea(model, data, *x).copy() for x in zip(q, dq, ddq, strict=True)]
            found.append(np.array(rows))
            if rules.friction is not None:
                found[-1] += rules.friction[0] * dq + rules.friction[2]
        return found

    def places(self, rules: Rules, q: np.ndarray) -> np.ndarray:
        """Centres of the tool's ball, `(N, 3)`."""
        data, number = self.model.createData(), self.model.getFrameId(rules.frame)
        body = self.model.frames[number].parentJoint
        at = self.model.frames[number].placement.act(np.array(rules.point))
        turns, origins = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        for k, posture in enumerate(q):
            pin.forwardKinematics(self.model, data, posture)
            turns[k], origins[k] = data.oMi[body].rotation, data.oMi[body].translation
        return origins + turns @ at

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Of all pairs of things, `(N, pairs)`."""
        data, solids = self.model.createData(), pin.GeometryData(self.solids)
        found = np.empty((len(q), len(self.solids.collisionPairs)))
        for k, posture in enumerate(q):
            pin.computeDistances(self.model, data, self.solids, solids, posture)
            found[k] = [result.min_distance for result in solids.distanceResults]
        return np.stack([found[:, which].min(axis=1) for which in self.pairs.values()], axis=1)

    def margins(self, rules: Rules, motion: dict[str, Any], count: int) -> dict[str, Any]:
        """Least margins of a motion at `count` samples and more, by constraint.

        Lists in the order in which certificates name them; of the clearance by pairs.
        """
        t = fine_times(motion, count)
        state = [derivative(motion, t, order) for order in range(4)]
        found = self.at(rules, *state)
        if rules.apart is not None and self.pairs:
            coarse = np.linspace(0.0, t[-1], COARSE)
            fine = self._near(motion, coarse, rules)
            seen = self.distances(derivative(motion, np.union1d(coarse, fine), 0))
            found["clearance"] = self._clear(rules, seen.min(axis=0))
        return found

    def _near(self, motion: dict[str, Any], coarse: np.ndarray, rules: Rules) -> np.ndarray:
        """Times about the least distances."""
        seen = self.distances(derivative(motion, coarse, 0))
        step, times = coarse[1], []
        for column in seen[:, seen.min(axis=0) < rules.apart + 0.03].T:
            for k in np.argsort(column)[:2]:
                times.append(coarse[k] + step * np.linspace(-1.0, 1.0, 41))
        return np.clip(np.concatenate(times), 0.0, coarse[-1]) if times else coarse[:1]

    def _clear(self, rules: Rules, least: np.ndarray) -> dict[frozenset[str], Margin]:
        """Margins of the pairs that count."""
        ignored = {frozenset(pair) for pair in rules.ignore}
        return {
            frozenset(pair): Margin(float(d - rules.apart), 0.05)
            for pair, d in zip(self.pairs, least, strict=True)
            if frozenset(pair) not in ignored
            and (rules.bodies or any(name.startswith("thing") for name in pair))
        }

    def at(
        self, rules: Rules, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, jerk: np.ndarray
    ) -> dict[str, Any]:
        """Least margins of states but for distances."""
        half = 0.5 * (rules.upper - rules.lower)
        found: dict[str, list[Margin]] = {"limits": _least(q - rules.lower, half)}
        found["limits"] += _least(rules.upper - q, half)
        for x, most in ((dq, rules.velocity), (ddq, rules.acceleration), (jerk, rules.jerk)):
            if most is not None:
                found["limits"] += _least(most - np.abs(x), most)
        if any(side is not None for side in rules.box) or rules.planes or rules.keep_out:
            found |= _of_tool(rules, self.places(rules, q))
        if rules.effort is not None or rules.power is not None:
            found |= _of_efforts(rules, self.effort(rules, q, dq, ddq), dq)
        return found


def _cases(rules: Rules) -> Iterator[tuple[float, float, np.ndarray, str]]:
    """Mass, inertia about its centre, place and frame of every load, twice."""
    for mass, place, name in rules.loads:
        radius = (mass / 1000.0 / (4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)
        for inertia in (0.0, 2.0 / 3.0 * mass * radius**2):
            yield mass, inertia, np.array(place), name


def _least(values: np.ndarray, sizes: np.ndarray) -> list[Margin]:
    return [Margin(float(v), float(s)) for v, s in zip(values.min(axis=0), sizes, strict=True)]


def _of_tool(rules: Rules, places: np.ndarray) -> dict[str, list[Margin]]:
    found: dict[str, list[Margin]] = {}
    sides = [(k, side) for k, side in enumerate(rules.box) if side is not None]
    if sides:
        margins = []
        for k, (low, high) in sides:
            margins += [places[:, k] - low, high - places[:, k]]
        found["tool box"] = [Margin(float(m.min()) - rules.radius, 0.05) for m in margins]
    if rules.planes:
        found["planes"] = [
            Margin(float((places @ n).min()) - d - rules.radius, 0.05) for n, d in rules.planes
        ]
    if rules.keep_out:
        found["forbidden boxes"] = []
        for low, high in rules.keep_out:
            nearest = np.clip(places, low, high)
            outside = np.linalg.norm(places - nearest, axis=1)
            inside = np.minimum(places - low, high - places).min(axis=1)
            signed = np.where(outside > 0.0, outside, -inside)
            found["forbidden boxes"].append(Margin(float(signed.min()) - rules.radius, 0.05))
    return found


def _of_efforts(rules: Rules, efforts: list[np.ndarray], dq: np.ndarray) -> dict[str, list[Margin]]:
    """Torques and powers, with the friction that turns counted the worse way."""
    turning = 0.0 if rules.friction is None else rules.friction[1]
    found: dict[str, list[Margin]] = {}
    if rules.effort is not None:
        finite = np.isfinite(rules.effort)
        most = rules.effort[finite]
        found["torque"] = []
        for effort in efforts:
            upper, lower = (rules.effort - turning - sign * effort for sign in (1.0, -1.0))
            found["torque"] += _least(upper[:, finite], most) + _least(lower[:, finite], most)
    if rules.power is not None:
        finite = np.isfinite(rules.power)
        most = rules.power[finite]
        found["power"] = []
        for effort in efforts:
            own, friction = effort * dq, turning * np.abs(dq)
            own, friction = (np.column_stack([x, x.sum(axis=1)]) for x in (own, friction))
            upper, lower = (rules.power - friction - sign * own for sign in (1.0, -1.0))
            found["power"] += _least(upper[:, finite], most) + _least(lower[:, finite], most)
    return found

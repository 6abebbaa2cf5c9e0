"""Distances of all that a robot moves from the walls of its cell, by Pinocchio and coal."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from proofs.support.safety_robots import Arm


@dataclass(frozen=True)
class Following:
    """Joints that are not moved by themselves.

    Attributes:
        count: Of all joints.
        mimic: A joint, its master, ratio and offset.
        locked: Positions by name.
    """

    count: int
    mimic: tuple[int, int, float, float] | None = None
    locked: Mapping[str, float] = field(default_factory=dict)

    @property
    def free(self) -> list[int]:
        """Joints that are moved."""
        dependent = {int(name[1:]) - 1 for name in self.locked}
        dependent |= {self.mimic[0]} if self.mimic else set()
        return [k for k in range(self.count) if k not in dependent]

    def all(self, q: np.ndarray) -> np.ndarray:
        """Positions of all joints, `(N, count)`, from those that are moved."""
        full = np.zeros((len(q), self.count))
        full[:, self.free] = q
        for name, position in self.locked.items():
            full[:, int(name[1:]) - 1] = position
        if self.mimic is not None:
            joint, master, ratio, offset = self.mimic
            full[:, joint] = ratio * full[:, master] + offset
        return full


@dataclass(frozen=True)
class Wall:
    """A half-space `normal @ p < level` that is forbidden, or a box.

    Attributes:
        name: As certificates call it.
        normal: Of length one, into the room.
        level: [m].
        low: Of a box, its least corner [m].
        high: Its greatest.
    """

    name: str
    normal: np.ndarray | None = None
    level: float = 0.0
    low: np.ndarray | None = None
    high: np.ndarray | None = None

    @property
    def solid(self) -> tuple[Any, pin.SE3]:
        """As coal has it, and where."""
        if self.normal is not None:
            return coal.Halfspace(self.normal, self.level), pin.SE3.Identity()
        return coal.Box(*(self.high - self.low)), pin.SE3(np.eye(3), 0.5 * (self.low + self.high))


@dataclass(frozen=True)
class CellJudge:
    """A robot in its cell.

    Attributes:
        arm: The robot.
        urdf: Its file.
        following: Joints that are not moved by themselves.
        balls: Of tool and loads: name, frame, place in it and radius [m].
        walls: What it keeps off.
        radii: Of capsules that stand for links without shapes [m].
    """

    arm: Arm
    urdf: Path
    following: Following
    balls: tuple[tuple[str, str, np.ndarray, float], ...]
    walls: tuple[Wall, ...] = ()
    radii: Mapping[str, float] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Joints that are moved."""
        return len(self.following.free)

    def within(self, share: np.ndarray) -> np.ndarray:
        """A posture at shares of the ranges; of a joint with a follower, nearer the middle."""
        free = [self.arm.links[k] for k in self.following.free]
        lower, upper = np.array([(link.lower, link.upper) for link in free]).T
        return np.asarray(lower + share * (upper - lower))

    @cached_property
    def _model(self) -> Any:
        text = re.sub(r"<mimic[^>]*/>", "", self.urdf.read_text())
        return pin.buildModelFromXML(text), text

    @cached_property
    def things(self) -> tuple[tuple[str, int, Any, pin.SE3], ...]:
        """All that moves: name, joint, solid and place on the joint."""
        model, text = self._model
        shapes = pin.buildGeomFromUrdfString(model, text, pin.COLLISION).geometryObjects
        found = [
            (re.sub(r"_\d+$", "", s.name), s.parentJoint, s.geometry, s.placement) for s in shapes
        ]
        for name, frame, place, radius in self.balls:
            at = model.frames[model.getFrameId(frame)]
            where = at.placement * pin.SE3(np.eye(3), place)
            found.append((name, at.parentJoint, coal.Sphere(radius), where))
        for name, radius in self.radii.items():
            found += self._capsules(int(name[4:]), radius)
        dependent = {int(name[1:]) for name in self.following.locked}
        first = next(k for k in range(1, len(self.arm.links) + 1) if k not in dependent)
        return tuple(thing for thing in found if thing[1] >= first)

    def _capsules(self, number: int, radius: float) -> list[tuple[str, int, Any, pin.SE3]]:
        """From a link's joint to the next, at both ends of a slide, and to twice its centre."""
        links = self.arm.links
        ends = [2.0 * np.array(links[number - 1].com)]
        if number < len(links):
            beyond, place = links[number], np.array(links[number].xyz)
            turned = pin.rpy.rpyToMatrix(*beyond.rpy) @ np.array(beyond.axis)
            slides = [beyond.lower, beyond.upper] if beyond.kind == "prismatic" else [0.0]
            if f"j{number + 1}" in self.following.locked and beyond.kind == "prismatic":
                slides = [self.following.locked[f"j{number + 1}"]]
            ends += [place + x * turned for x in slides]
        else:
            ends.append(np.array(self.arm.tool))
        found = []
        for end in ends:
            length = float(np.linalg.norm(end))
            if length > 2e-3:
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length)
                where = pin.SE3(turn.matrix(), 0.5 * end)
                found.append((f"link{number}", number, coal.Capsule(radius, length), where))
        return found

    @cached_property
    def _geometry(self) -> Any:
        """Things and walls, with all pairs of one of each."""
        whole = pin.GeometryModel()
        for number, (name, joint, solid, place) in enumerate(self.things):
            whole.addGeometryObject(pin.GeometryObject(f"{name} {number}", joint, place, solid))
        for wall in self.walls:
            solid, place = wall.solid
            whole.addGeometryObject(pin.GeometryObject(wall.name, 0, place, solid))
        for i in range(len(self.things)):
            for j in range(len(self.walls)):
                whole.addCollisionPair(pin.CollisionPair(i, len(self.things) + j))
        return whole

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Names of thing and wall."""
        return [(thing[0], wall.name) for thing in self.things for wall in self.walls]

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Of every thing from every wall, `(N, pairs)` [m]."""
        model, geometry = self._model[0], self._geometry
        data, found = model.createData(), pin.GeometryData(geometry)
        full = self.following.all(q)
        seen = np.empty((len(q), len(geometry.collisionPairs)))
        for k, posture in enumerate(full):
            pin.computeDistances(model, data, geometry, found, posture)
            seen[k] = [result.min_distance for result in found.distanceResults]
        return seen

    def lowest(self, posture: np.ndarray, normal: np.ndarray) -> float:
        """Least height of all that moves along a direction at a posture [m]."""
        from dataclasses import replace

        far = replace(self, walls=(Wall("far", normal, -100.0),))
        return float(far.distances(posture[None]).min()) - 100.0

    def somewhere(self, posture: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Where some thing is at a posture [m]."""
        model = self._model[0]
        data = model.createData()
        pin.forwardKinematics(model, data, self.following.all(posture[None])[0])
        _, joint, _, place = self.things[int(random.integers(len(self.things)))]
        return np.asarray((data.oMi[joint] * place).translation)

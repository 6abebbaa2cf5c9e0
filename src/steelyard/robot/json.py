"""A robot as plain JSON, and back, exact to the bit."""

from dataclasses import asdict
from typing import Any

import numpy as np

from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import (
    Body,
    Coordinate,
    Frame,
    Limits,
    Loop,
    Robot,
    Transmission,
)


def robot_to_dict(robot: Robot) -> dict[str, Any]:
    """Everything a robot is, as JSON values; unknown limits are left out."""
    gears = robot.transmission
    return {
        "name": robot.name,
        "gravity": robot.gravity.tolist(),
        "coordinates": [_coordinate_to_dict(c) for c in robot.coordinates],
        "bodies": [_body_to_dict(body) for body in robot.bodies],
        "passive": [_coordinate_to_dict(c) for c in robot.passive],
        "loops": [{**vars(loop), "points": loop.points.tolist()} for loop in robot.loops],
        "assembly": robot.assembly.tolist(),
        "open_loops": robot.open_loops,
        "transmission": gears and {"motors": list(gears.motors), "matrix": gears.matrix.tolist()},
        "frames": [
            {**vars(f), "rotation": f.rotation.tolist(), "position": f.position.tolist()}
            for f in robot.frames
        ],
    }


def robot_from_dict(data: dict[str, Any]) -> Robot:
    """The robot that `robot_to_dict` wrote."""
    gears = data["transmission"]
    return Robot(
        name=data["name"],
        bodies=tuple(_body_from_dict(body) for body in data["bodies"]),
        coordinates=tuple(_coordinate_from_dict(c) for c in data["coordinates"]),
        gravity=data["gravity"],
        passive=tuple(_coordinate_from_dict(c) for c in data["passive"]),
        loops=tuple(Loop(d["name"], tuple(d["bodies"]), d["points"]) for d in data["loops"]),
        assembly=data["assembly"],
        open_loops=data["open_loops"],
        transmission=gears and Transmission(tuple(gears["motors"]), gears["matrix"]),
        frames=tuple(Frame(**frame) for frame in data["frames"]),
    )


def _coordinate_to_dict(coordinate: Coordinate) -> dict[str, Any]:
    limits = {k: v for k, v in asdict(coordinate.limits).items() if np.isfinite(v)}
    return {"name": coordinate.name, "kind": coordinate.kind, "limits": limits}


def _coordinate_from_dict(data: dict[str, Any]) -> Coordinate:
    return Coordinate(data["name"], data["kind"], Limits(**data["limits"]))


def _body_to_dict(body: Body) -> dict[str, Any]:
    return {
        "name": body.name,
        "joint": body.joint,
        "kind": body.kind,
        "parent": body.parent,
        "rotation": body.rotation.tolist(),
        "position": body.position.tolist(),
        "axis": body.axis.tolist(),
        "coordinate": body.coordinate,
        "ratio": body.ratio,
        "offset": body.offset,
        "inertia": body.inertia.ten.tolist(),
        "known": body.known,
        **({"massless": True} if body.massless else {}),
    }


def _body_from_dict(data: dict[str, Any]) -> Body:
    return Body(**{**data, "inertia": Inertia.from_ten(data["inertia"])})

"""A robot as plain JSON, and back, exact to the bit."""

from dataclasses import asdict
from typing import Any

import numpy as np

from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import Body, Coordinate, Limits, Robot


def robot_to_dict(robot: Robot) -> dict[str, Any]:
    """Everything a robot is, as JSON values; unknown limits are left out."""
    return {
        "name": robot.name,
        "gravity": robot.gravity.tolist(),
        "coordinates": [
            {
                "name": c.name,
                "kind": c.kind,
                "limits": {k: v for k, v in asdict(c.limits).items() if np.isfinite(v)},
            }
            for c in robot.coordinates
        ],
        "bodies": [_body_to_dict(body) for body in robot.bodies],
    }


def robot_from_dict(data: dict[str, Any]) -> Robot:
    """The robot that `robot_to_dict` wrote."""
    return Robot(
        name=data["name"],
        bodies=tuple(_body_from_dict(body) for body in data["bodies"]),
        coordinates=tuple(
            Coordinate(c["name"], c["kind"], Limits(**c["limits"])) for c in data["coordinates"]
        ),
        gravity=data["gravity"],
    )


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
    }


def _body_from_dict(data: dict[str, Any]) -> Body:
    return Body(**{**data, "inertia": Inertia.from_ten(data["inertia"])})

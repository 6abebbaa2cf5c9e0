"""Robots that benchmarks compute with."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import dh_mechanism
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.sections import DHRow
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Body, Coordinate, Robot
from steelyard.robot.robot_from_mechanism import reduced

ROOT = Path(__file__).parent.parent
LINK = Inertia.about_com(2.0, [0.02, 0.0, 0.05], 0.02 * np.eye(3))


def seven_joints() -> Model:
    """Rigid bodies, Coulomb and viscous friction of an arm with seven joints."""
    if os.environ.get("STEELYARD_DATA"):
        robot = load_robot(ROOT / "examples" / "panda.toml").robot
    else:
        twists = (0.0, -np.pi / 2, np.pi / 2, np.pi / 2, -np.pi / 2, np.pi / 2, np.pi / 2)
        offsets = (0.3, 0.0, 0.35, 0.0, 0.4, 0.0, 0.1)
        rows = [DHRow(alpha=a, d=d) for a, d in zip(twists, offsets, strict=True)]
        robot = reduced(dh_mechanism(rows, "modified", "seven joints"))[0]
        robot = robot.changed(bodies=tuple(replace(body, inertia=LINK) for body in robot.bodies))
    return Model(robot, (RigidBody(), Coulomb(), Viscous()))


def limbs(n: int) -> Robot:
    """A trunk with limbs of seven joints each."""
    rng = np.random.default_rng(0)
    bodies = [
        Body(
            name=f"body{k}", joint=f"joint{k}", kind="revolute",
            parent=0 if k % 7 == 1 else k - 1,
            rotation=np.roll(np.eye(3), int(rng.integers(3)), axis=0), position=[0.1, 0.0, 0.3],
            axis=[0.0, 0.0, 1.0], coordinate=k,
        )
        for k in range(n)
    ]  # fmt: skip
    joints = tuple(Coordinate(body.joint, body.kind) for body in bodies)
    return Robot(f"{n} joints", tuple(bodies), joints)

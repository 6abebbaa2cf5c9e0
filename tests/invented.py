"""Invented robots with awkward corners, for laws and oracles."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.sections import DHRow
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.models.denavit_hartenberg import dh_mechanism
from steelyard.robot.models.xml_and_urdf import read_urdf
from steelyard.robot.robot import BASE_COORDINATES, Body, Coordinate, Robot
from steelyard.robot.robot_from_mechanism import reduced


def ball(seed: int) -> Inertia:
    """A physically consistent body, different for every seed."""
    rng = np.random.default_rng(seed)
    spread = rng.normal(size=(3, 3)) * 0.1
    sigma = spread @ spread.T + 0.002 * np.eye(3)
    mass = rng.uniform(0.5, 4.0)
    return Inertia.about_com(mass, rng.normal(size=3) * 0.1, np.trace(sigma) * np.eye(3) - sigma)


def turned(seed: int) -> np.ndarray:
    """A random rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def single() -> Robot:
    """One joint: rows narrower than a tile."""
    body = Body("rod", "hinge", "revolute", -1, np.eye(3), np.zeros(3), [0.0, 1.0, 0.0], 0)
    named = Body(**{**vars(body), "inertia": ball(1), "known": True})
    return Robot("single", (named,), (Coordinate("hinge", "revolute"),))


def tree() -> Robot:
    """Two branches, a prismatic joint, skew axes, gravity askew."""
    skew = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    rows = [
        ("trunk", "revolute", -1, [0.0, 0.0, 1.0]),
        ("slider", "prismatic", 0, skew),
        ("left", "revolute", 0, skew),
        ("tip", "revolute", 1, [1.0, 0.0, 0.0]),
    ]
    bodies = tuple(
        Body(n, f"{n}_joint", k, p, turned(i), [0.1, 0.2 * i, -0.3], a, i, 1.0, 0.0, ball(i), True)
        for i, (n, k, p, a) in enumerate(rows)
    )
    coordinates = tuple(Coordinate(f"{n}_joint", k) for n, k, _, _ in rows)
    return Robot("tree", bodies, coordinates, (1.0, -3.0, -9.0))


def dh_arm() -> Robot:
    """Three rows of a modified Denavit-Hartenberg table."""
    six = (0.02, 0.001, 0.03, 0.0, 0.002, 0.025)
    rows = [
        DHRow(a=a, alpha=alpha, d=d, mass=m, com=(0.1, 0.0, 0.05), inertia_com=six)
        for a, alpha, d, m in (
            (0.0, 0.0, 0.3, 4.0),
            (0.1, -np.pi / 2, 0.0, 3.0),
            (0.4, 0.3, 0.1, 2.0),
        )
    ]
    return reduced(dh_mechanism(rows, "modified", "dh arm"))[0]


def floating(robot: Robot, seed: int = 7) -> Robot:
    """The same robot on a base that floats."""
    base = Body(
        "pelvis", "floating", "floating", -1, np.eye(3), np.zeros(3), [0.0, 0.0, 1.0], 0,
        inertia=ball(seed), known=True,
    )  # fmt: skip
    n = len(BASE_COORDINATES)
    return robot.changed(
        bodies=(
            base,
            *(replace(b, parent=b.parent + 1, coordinate=b.coordinate + n) for b in robot.bodies),
        ),
        coordinates=(*BASE_COORDINATES, *robot.coordinates),
        frames=tuple(replace(f, body=f.body + 1) for f in robot.frames),
        loops=tuple(replace(x, bodies=(x.bodies[0] + 1, x.bodies[1] + 1)) for x in robot.loops),
        assembly=np.concatenate([np.zeros(n), robot.assembly]),
    )


URDF = """<robot name="mimic">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0.1 0 0" rpy="0.1 0.2 0.3"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.025"/></inertial></link>
  <link name="plate"><inertial><origin xyz="0 0 0.02"/><mass value="0.5"/>
    <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.003"/></inertial></link>
  <link name="follower"><inertial><origin xyz="0.05 0.01 0"/><mass value="1"/>
    <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.004" iyz="0" izz="0.003"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="3"/></joint>
  <joint name="weld" type="fixed"><parent link="arm"/><child link="plate"/>
    <origin xyz="0.2 0 0.1" rpy="0 0.5 0"/></joint>
  <joint name="twin" type="continuous"><parent link="plate"/><child link="follower"/>
    <origin xyz="0.1 0 0"/><axis xyz="0 0 1"/>
    <mimic joint="shoulder" multiplier="-1.5" offset="0.2"/>
  </joint>
</robot>"""


def mimic(folder: Path) -> Robot:
    """A URDF with a fixed and a mimic joint."""
    path = folder / "mimic.urdf"
    path.write_text(URDF)
    return reduced(read_urdf(path))[0]


def measured(name: str) -> Robot:
    """A robot of the shared data; skips without it."""
    data = os.environ.get("STEELYARD_DATA")
    if not data:
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    return load_robot(Path(__file__).parent.parent / "examples" / f"{name}.toml").robot


ROBOTS: dict[str, Callable[[Path], Robot]] = {
    "single": lambda _: single(),
    "tree": lambda _: tree(),
    "dh arm": lambda _: dh_arm(),
    "mimic": mimic,
    "ur10e": lambda _: measured("ur10e"),
    "panda": lambda _: measured("panda"),
}

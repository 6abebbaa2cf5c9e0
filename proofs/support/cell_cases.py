"""Random robots in random cells: floor, planes and boxes that leave room about one posture."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support.cell_judge import CellJudge, Following, Wall
from proofs.support.safety_robots import Arm, arm_urdf, random_arm
from proofs.support.safety_toml import tables_text

FAMILIES = ("fourier", "blended_fourier", "ramped_fourier", "spline", "reaching")
ROOM = 0.03
"""What is left about the posture [m]."""

WIDE = 0.12
"""Radius that links without shapes are given to draw walls [m]."""

SIX = 4
"""Every so many arms have six revolute joints, for URScript."""


@dataclass(frozen=True)
class Cell:
    """A robot in its cell.

    Attributes:
        file: The robot file.
        judge: The same for Pinocchio and coal.
        kind: Of motion.
        every: Whether torque and clearance are limited, too.
        bare: Links that have no shape.
        six: Whether it moves six revolute joints.
    """

    file: Path
    judge: CellJudge
    kind: str
    every: bool
    bare: tuple[str, ...]
    six: bool


def random_cell(seed: int, folder: Path) -> Cell:
    """Cell number `seed`, with its files in a folder."""
    random = np.random.default_rng([40, seed])
    six = seed % SIX == 0
    arm = _arm(random, six)
    following = Following(len(arm.links)) if six else _following(random, arm)
    urdf = folder / "arm.urdf"
    urdf.write_text(_with_mimic(arm_urdf(arm), following))
    tables: dict[str, Any] = {"samples": 100, "limits": {"share": 0.95}}
    every = bool(random.random() < 0.25)
    if not every:
        tables |= {"limits": {"effort": "any"}, "collision": {"bodies": False}}
    balls = _carried(random, tables)
    bare = tuple(f"link{k}" for k, link in enumerate(arm.links, start=1) if not link.parts)
    judge = CellJudge(arm, urdf, following, balls, radii=dict.fromkeys(bare, WIDE))
    posture = judge.within(0.5 + 0.3 * random.uniform(-1.0, 1.0, judge.n))
    workspace, walls = _walls(random, judge, posture)
    tables["workspace"] = {**tables.pop("tool", {}), **workspace}
    judge = replace(judge, walls=tuple(walls))
    kind = FAMILIES[seed % len(FAMILIES)]
    tables["motion"] = _motion(random, kind)
    if random.random() < 0.3:
        tables["motion"]["start"] = [float(x) for x in posture]
    locked = ", ".join(f"{name} = {x!r}" for name, x in following.locked.items())
    head = ['[robot]\nurdf = "arm.urdf"', f"locked = {{ {locked} }}" if locked else ""]
    text = [*head, '[model]\nterms = ["rigid_body", "viscous"]', tables_text(tables)]
    file = folder / "robot.toml"
    file.write_text("\n".join(text))
    return Cell(file, judge, kind, every, bare, six)


def _arm(random: np.random.Generator, six: bool) -> Arm:
    """A serial arm; some have shapes on all links, some on most, some on none."""
    whole = random.random() < 0.4
    while True:
        arm = random_arm(random, bool(random.random() < 0.6))
        turning = all(link.kind == "revolute" for link in arm.links)
        right = not six or (len(arm.links) == 6 and turning)
        if right and (not whole or all(link.parts for link in arm.links)):
            return arm


def _following(random: np.random.Generator, arm: Arm) -> Following:
    """Sometimes a joint that follows an earlier one, sometimes one that is locked."""
    count = len(arm.links)
    found = Following(count)
    last = count - 1
    masters = [k for k in range(last) if arm.links[k].kind == arm.links[last].kind]
    if count > 2 and masters and random.random() < 0.4:
        ratio = float(random.choice([-1.0, 0.5, 0.8]))
        found = replace(found, mimic=(last, masters[-1], ratio, float(random.uniform(-0.1, 0.1))))
    if count > 3 and random.random() < 0.4:
        free = [k for k in range(1, last) if found.mimic is None or k != found.mimic[1]]
        if free:
            k = int(random.choice(free))
            link = arm.links[k]
            found = replace(found, locked={f"j{k + 1}": 0.5 * (link.lower + link.upper)})
    return found


def _with_mimic(urdf: str, following: Following) -> str:
    """The URDF with the joint that follows."""
    if following.mimic is None:
        return urdf
    joint, master, ratio, offset = following.mimic
    element = f'<mimic joint="j{master + 1}" multiplier="{ratio!r}" offset="{offset!r}"/>'
    pattern = rf'(<joint name="j{joint + 1}".*?)</joint>'
    return re.sub(pattern, rf"\g<1>{element}</joint>", urdf, count=1, flags=re.DOTALL)


def _carried(
    random: np.random.Generator, tables: dict[str, Any]
) -> tuple[tuple[str, str, np.ndarray, float], ...]:
    """Balls of the tool and of loads: name, frame, place and radius; and their tables."""
    tool: dict[str, Any] = {}
    point, radius = np.zeros(3), 0.0
    if random.random() < 0.5:
        radius = float(random.uniform(0.01, 0.08))
        tool["radius"] = radius
    if random.random() < 0.4:
        point = random.uniform(-0.1, 0.1, 3)
        tool["point"] = [float(x) for x in point]
    tables["tool"] = tool
    name = f"ball of radius {1e3 * radius:.3g} mm at tool" if radius else "tool point at tool"
    balls = [(name, "tool", point, radius or 1e-6)]
    if random.random() < 0.4:
        tables["loads"] = []
        for number in range(1, int(random.integers(2, 4))):
            mass, place = float(random.uniform(0.2, 5.0)), random.uniform(-0.1, 0.1, 3)
            load = {"mass": mass, "com": [float(x) for x in place]}
            own = float((3.0 * mass / (4.0 * np.pi * 1000.0)) ** (1.0 / 3.0))
            if random.random() < 0.5:
                own = load["radius"] = float(random.uniform(0.02, 0.12))
            tables["loads"].append(load)
            balls.append((f"load {number} (ball of radius {1e3 * own:.3g} mm)", "tool", place, own))
    return tuple(balls)


def _walls(
    random: np.random.Generator, judge: CellJudge, posture: np.ndarray
) -> tuple[dict[str, Any], list[Wall]]:
    """Floor, planes and boxes, of each some or none, and at least one."""
    tables: dict[str, Any] = {}
    walls: list[Wall] = []

    def gap() -> float:
        return float(ROOM + random.uniform(0.0, 0.25))

    if random.random() < 0.7:
        up = np.array([0.0, 0.0, 1.0])
        tables["floor"] = judge.lowest(posture, up) - gap()
        walls.append(Wall("floor", up, tables["floor"]))
    if random.random() < 0.4 or not walls:
        tables["planes"] = []
        for number in range(1, int(random.integers(2, 4))):
            normal = random.standard_normal(3)
            unit = normal / np.linalg.norm(normal)
            level = judge.lowest(posture, unit) - gap()
            tables["planes"].append(
                {
                    "normal": [float(x) for x in normal],
                    "above": float(level * np.linalg.norm(normal)),
                }
            )
            walls.append(Wall(f"plane {number}", unit, level))
    boxes = _boxes(random, judge, posture) if random.random() < 0.6 else []
    if boxes:
        tables["keep_out"] = [
            dict(zip("xyz", np.stack(b, axis=1).tolist(), strict=True)) for b in boxes
        ]
    for number, (low, high) in enumerate(boxes, start=1):
        walls.append(Wall(f"forbidden box {number}", low=low, high=high))
    return tables, walls


def _boxes(
    random: np.random.Generator, judge: CellJudge, posture: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Up to two boxes near the robot that nothing touches at the posture."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(30):
        middle = judge.somewhere(posture, random) + random.uniform(-0.4, 0.4, 3)
        half = random.uniform(0.05, 0.3, 3)
        wall = Wall("box", low=middle - half, high=middle + half)
        seen = replace(judge, walls=(wall,)).distances(posture[None])
        if seen.size and seen.min() > ROOM:
            found.append((middle - half, middle + half))
        if len(found) == 2:
            break
    return found


def _motion(random: np.random.Generator, kind: str) -> dict[str, Any]:
    """A short motion of a kind."""
    motion: dict[str, Any] = {"kind": kind}
    if kind.endswith("fourier"):
        motion |= {"period": float(random.uniform(3.0, 8.0)), "harmonics": 3}
    if kind in ("blended_fourier", "ramped_fourier"):
        motion["blend" if kind == "blended_fourier" else "ramp"] = 0.3 * motion["period"]
    if kind == "spline":
        motion |= {"duration": float(random.uniform(3.0, 8.0)), "points": 11}
    if kind == "reaching":
        motion |= {"targets": 4, "move": float(random.uniform(0.8, 1.5))}
    return motion

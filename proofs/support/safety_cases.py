"""Random design problems that can be kept: every wall leaves room about one random posture."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support.safety_judge import Judge, Rules
from proofs.support.safety_robots import Arm, Part, arm_urdf, cell_urdf, random_arm, random_obstacle
from proofs.support.safety_toml import tables_text

FAMILIES = ("fourier", "raw_fourier", "blended_fourier", "ramped_fourier", "spline", "reaching")
CRITERIA = (
    "condition",
    "normalised_condition",
    "d_optimal",
    "a_optimal",
    "e_optimal",
)
ROOM = 0.02
"""What is left about the posture: metres of distances, and of a joint's range this share."""


@dataclass(frozen=True)
class Case:
    """A robot, the requirements on its motion, and the same in numbers for the judge.

    Attributes:
        file: The robot file.
        judge: The robot.
        rules: What must be kept.
        kind: Of motion.
        standard: What an earlier log knows, by name, if there is one.
        tables: The `[excitation]` tables.
    """

    file: Path
    judge: Judge
    rules: Rules
    kind: str
    standard: dict[str, float] | None
    tables: dict[str, Any]


@dataclass
class _Draft:
    """A case on its way: tables and rules grow together."""

    random: np.random.Generator
    arm: Arm
    judge: Judge
    rules: Rules
    posture: np.ndarray
    tables: dict[str, Any] = field(default_factory=dict)
    world: list[Part] = field(default_factory=list)

    def chance(self, share: float) -> bool:
        return bool(self.random.random() < share)

    def keep(self, **rules: Any) -> None:
        self.rules = replace(self.rules, **rules)


def random_case(seed: int, folder: Path) -> Case:
    """Case number `seed`, with its files in a folder."""
    random = np.random.default_rng([35, seed])
    folder.mkdir(parents=True, exist_ok=True)
    draft = _drafted(random, folder)
    _add_motion(draft, FAMILIES[seed % len(FAMILIES)])
    draft.tables["criterion"] = {"kind": CRITERIA[int(random.integers(len(CRITERIA)))]}
    if draft.chance(0.3):
        draft.tables["criterion"]["weights"] = _list(random.uniform(0.2, 2.0, len(draft.posture)))
    _add_tool(draft)
    standard = _add_efforts(draft)
    _add_clearance(draft)
    judge = _judged(draft, folder)
    tables = {"samples": 100, **draft.tables}
    text = ['[robot]\nurdf = "arm.urdf"', '[model]\nterms = ["rigid_body", "viscous", "coulomb"']
    text[1] += ', "offset"]' if standard is not None else "]"
    file = folder / "robot.toml"
    file.write_text("\n".join([*text, tables_text(tables)]))
    return Case(file, judge, draft.rules, draft.tables["motion"]["kind"], standard, tables)


def tightened(case: Case, share: float) -> tuple[Case, Rules]:
    """The same case with speeds, accelerations, jerks and efforts less by a share."""
    limits = case.tables["limits"] | {"share": case.tables["limits"]["share"] * share}
    tables = case.tables | {"limits": limits}
    file = case.file.with_name("tightened.toml")
    head = case.file.read_text().split("[excitation]")[0]
    file.write_text(head + tables_text(tables))
    rules = case.rules
    known = {
        name: share * value
        for name in ("velocity", "acceleration", "jerk", "effort")
        if (value := getattr(rules, name)) is not None
    }
    return replace(case, file=file, tables=tables), replace(rules, **known)


def _judged(draft: _Draft, folder: Path) -> Judge:
    """The judge of the finished robot and cell."""
    (folder / "arm.urdf").write_text(arm_urdf(draft.arm))
    cell = None
    if draft.world:
        cell = folder / "cell.urdf"
        cell.write_text(cell_urdf(draft.world))
    return Judge(draft.arm, folder / "arm.urdf", cell)


def _drafted(random: np.random.Generator, folder: Path) -> _Draft:
    """A robot, its limits and a posture in which it touches nothing."""
    shaped = bool(random.random() < 0.6)
    while True:
        arm = random_arm(random, shaped)
        (folder / "arm.urdf").write_text(arm_urdf(arm))
        judge = Judge(arm, folder / "arm.urdf")
        limits, rules = _limits(random, arm)
        half = 0.5 * (rules.upper - rules.lower)
        for _ in range(20):
            posture = rules.lower + half * (1.0 + 0.6 * random.uniform(-1.0, 1.0, len(half)))
            if not judge.pairs or judge.distances(posture[None]).min() > 0.03 + ROOM:
                return _Draft(random, arm, judge, rules, posture, {"limits": limits})


def _limits(random: np.random.Generator, arm: Arm) -> tuple[dict[str, Any], Rules]:
    """The table of limits, and what it means."""
    n = len(arm.links)
    share = float(random.choice([1.0, 0.95, 0.8]))
    own = np.array([(k.lower, k.upper, k.velocity) for k in arm.links])
    turning = np.array([link.kind == "revolute" for link in arm.links])
    span = own[:, 1] - own[:, 0]
    margin, limits = 0.02 * span, dict[str, Any](share=share)
    if random.random() < 0.5:
        limits["position_margin"] = float(random.choice([0.0, 0.02]))
        margin = np.full(n, limits["position_margin"])
    speed, bend = own[:, 2], np.where(turning, 5.0, 1.0)
    if random.random() < 0.4:
        speed = own[:, 2] * random.uniform(0.4, 1.0, n)
        limits["velocity"] = _list(speed)
    if random.random() < 0.6:
        bend = bend * np.exp(random.uniform(-1.0, 1.5, n))
        limits["acceleration"] = {f"j{k + 1}": x for k, x in enumerate(_list(bend))}
    jerk = None
    if random.random() < 0.3:
        jerk = bend * random.uniform(2.0, 15.0, n)
        limits["jerk"] = _list(jerk)
    return limits, Rules(
        own[:, 0] + margin,
        own[:, 1] - margin,
        share * speed,
        share * bend,
        None if jerk is None else share * jerk,
    )


def _add_motion(draft: _Draft, kind: str) -> None:
    """A family with random numbers; sometimes a start, sometimes an end near by."""
    random = draft.random
    motion: dict[str, Any] = {"kind": kind}
    if kind.endswith("fourier"):
        motion["period"] = float(random.uniform(3.0, 10.0))
        motion["harmonics"] = int(random.integers(2, 6))
    if kind in ("blended_fourier", "ramped_fourier"):
        motion["periods"] = int(random.integers(1, 3))
        word = "blend" if kind == "blended_fourier" else "ramp"
        motion[word] = float(random.uniform(0.8, 0.45 * motion["period"]))
    if kind == "spline":
        motion["duration"] = float(random.uniform(3.0, 10.0))
        motion["points"] = int(random.integers(9, 16))
        motion["degree"] = int(random.choice([3, 5]))
    if kind == "reaching":
        motion["targets"] = int(random.integers(3, 8))
        motion["move"] = float(random.uniform(0.6, 1.5))
        motion["dwell"] = float(random.choice([0.0, 0.2]))
    if kind != "raw_fourier" and draft.chance(0.3):
        motion["start"] = _list(draft.posture)
        if kind in ("fourier", "spline") and draft.chance(0.3):
            way = 0.02 * (draft.rules.upper - draft.rules.lower)
            motion["end"] = _list(draft.posture + way * random.uniform(-1.0, 1.0, len(way)))
    draft.tables["motion"] = motion


def _add_tool(draft: _Draft) -> None:
    """A box, planes and forbidden boxes about where the tool is at the posture."""
    random, workspace = draft.random, dict[str, Any]()
    if draft.chance(0.4):
        return
    if draft.chance(0.4):
        frame = f"link{random.integers(min(2, len(draft.posture)), len(draft.posture) + 1)}"
        workspace["frame"] = frame
        draft.keep(frame=frame)
    if draft.chance(0.4):
        point = _list(random.uniform(-0.1, 0.1, 3))
        workspace |= {"point": point, "radius": float(random.uniform(0.0, 0.08))}
        draft.keep(point=tuple(point), radius=workspace["radius"])
    place = draft.judge.places(draft.rules, draft.posture[None])[0]
    room = draft.rules.radius + ROOM
    if draft.chance(0.6):
        spans = np.stack([place - room, place + room]).T
        spans += random.uniform(0.05, 0.5, (3, 2)) * [-1.0, 1.0]
        box = [span if draft.chance(0.7) else None for span in spans.tolist()]
        workspace["box"] = {axis: span for axis, span in zip("xyz", box, strict=True) if span}
        draft.keep(box=tuple(box))
    if draft.chance(0.4):
        planes = []
        for _ in range(random.integers(1, 3)):
            normal = random.standard_normal(3)
            unit = normal / np.linalg.norm(normal)
            planes.append((normal, unit, unit @ place - room - random.uniform(0.03, 0.3)))
        workspace["planes"] = [
            {"normal": _list(n), "above": float(d * np.linalg.norm(n))} for n, _, d in planes
        ]
        draft.keep(planes=tuple((unit, float(d)) for _, unit, d in planes))
    if draft.chance(0.4):
        boxes = [_box_beside(random, place, room) for _ in range(random.integers(1, 3))]
        spans = [np.stack(box, axis=1).tolist() for box in boxes]
        workspace["keep_out"] = [dict(zip("xyz", span, strict=True)) for span in spans]
        draft.keep(keep_out=tuple(boxes))
    if set(workspace) & {"box", "planes", "keep_out"}:
        draft.tables["workspace"] = {"only_tool": True, **workspace}


def _box_beside(
    random: np.random.Generator, place: np.ndarray, room: float
) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a box that keeps off a place along one axis at least."""
    half = random.uniform(0.05, 0.3, 3)
    middle = place + random.uniform(-0.3, 0.3, 3)
    axis, side = random.integers(3), random.choice([-1.0, 1.0])
    middle[axis] = place[axis] + side * (half[axis] + room + random.uniform(0.02, 0.2))
    return middle - half, middle + half


def _add_efforts(draft: _Draft) -> dict[str, float] | None:
    """Loads, friction as an earlier log knows it, limits of effort and power."""
    random, n, limits = draft.random, len(draft.posture), draft.tables["limits"]
    if draft.chance(0.2):
        loads = [
            (float(random.uniform(0.2, 3.0)), tuple(_list(random.uniform(-0.1, 0.1, 3))), "tool")
            for _ in range(random.integers(1, 3))
        ]
        draft.tables["loads"] = [{"mass": m, "com": list(p)} for m, p, _ in loads]
        draft.keep(loads=tuple(loads))
    if draft.chance(0.4):
        draft.keep(friction=random.uniform([[0.0], [0.0], [-0.3]], [[1.0], [2.0], [0.3]], (3, n)))
    still = np.zeros((1, n))
    static = draft.judge.effort(draft.rules, draft.posture[None], still, still)
    least = np.abs(static).max(axis=(0, 1))
    least = 1.3 * least + 0.2 * least.max() + 2.0
    if draft.rules.friction is not None:
        least += draft.rules.friction[1]
    most = least * random.uniform(1.0, 3.0, n)
    share = limits["share"]
    match int(random.integers(3)):
        case 0:
            limits["effort"] = "any"
        case 1:
            draft.arm = draft.arm.with_efforts(most / share)
            draft.keep(effort=share * (most / share))
        case 2:
            limits["effort"] = _list(most / share)
            draft.keep(effort=share * (most / share))
    powers = np.full(n + 1, np.inf)
    if draft.chance(0.25):
        powers[:n] = random.uniform(2.0, 60.0, n)
        limits["power"] = _list(powers[:n])
    if draft.chance(0.25):
        powers[n] = limits["total_power"] = float(random.uniform(5.0, 150.0))
    if np.isfinite(powers).any():
        draft.keep(power=powers)
    if draft.rules.friction is None:
        return None
    laws = zip(("viscous", "coulomb", "offset"), draft.rules.friction, strict=True)
    return {f"{law}.j{k + 1}": float(x[k]) for law, x in laws for k in range(n)}


def _add_clearance(draft: _Draft) -> None:
    """Self-collision by default where there are shapes; sometimes specified, sometimes a cell."""
    random = draft.random
    if not draft.judge.pairs:
        return
    draft.keep(apart=0.01)
    if draft.chance(0.3):
        return
    wanted: dict[str, Any] = {"margin": float(random.choice([0.0, 0.005, 0.02, 0.03]))}
    draft.keep(apart=wanted["margin"])
    if draft.chance(0.2):
        pair = list(draft.judge.pairs)[int(random.integers(len(draft.judge.pairs)))]
        if len(draft.judge.pairs) > 1:
            wanted["ignore"] = [list(pair)]
            draft.keep(ignore=(pair,))
    if draft.chance(0.5):
        _add_cell(draft, wanted)
    draft.tables["collision"] = wanted


def _add_cell(draft: _Draft, wanted: dict[str, Any]) -> None:
    """Things that the robot does not touch at the posture."""
    random, folder = draft.random, draft.judge.urdf.parent
    if draft.chance(0.3):
        wanted["bodies"] = False
        draft.keep(bodies=False)
    place = draft.judge.places(draft.rules, draft.posture[None])[0]
    for _ in range(30):
        thing = random_obstacle(random, place + random.uniform(-0.6, 0.6, 3))
        (folder / "cell.urdf").write_text(cell_urdf([thing]))
        judge = Judge(draft.arm, draft.judge.urdf, folder / "cell.urdf")
        seen = judge.distances(draft.posture[None])[0]
        touched = [d for d, pair in zip(seen, judge.pairs, strict=True) if pair[1] == "thing1"]
        if min(touched) > wanted["margin"] + ROOM:
            draft.world.append(thing)
        if len(draft.world) == 2:
            break
    if draft.world:
        wanted["world"] = "cell.urdf"
    else:
        wanted.pop("bodies", None)
        draft.keep(bodies=True)


def _list(values: np.ndarray) -> list[float]:
    return [float(value) for value in values]

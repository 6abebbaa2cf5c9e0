"""Mistakes planted in measured logs of ten real robots: what `check` says of them.

Each log is read as its robot file, or its source, says; then one or two mistakes are put into its
columns, or another gravity into the robot file. The judge knows what was planted: a finding that is
wrong must be of a planted cause and of no other joint, and a changed line must undo what was
planted. A log that does not decide a question may leave it open, or doubtful.
"""

import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from proofs.checks.five_robots import EXAMPLES, LOGS
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.check.case_from_files_and_precheck import Subject, subject_of
from steelyard.check.check import CheckResult, check
from steelyard.check.finding import Finding, Severity
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_edits import Edit, edited
from steelyard.runs.runs_of_named_logs import log_files

EFFORT = ("signals", "effort")
COUNTS = 101.0 * np.array([3.442383e-4, 3.442383e-4, -3.442383e-4, *[1.342773e-4] * 3])
OTHERS: dict[str, tuple[str, str, list[Edit]]] = {
    "med7": (
        "med7/med7dock.urdf",
        "med7/med7_measurements.parquet",
        [Edit((*EFFORT, "gain"), [-1.0] * 7)],
    ),
    "ur10": ("ur10/ur10_robot.urdf", "ur10/ur10_exciting.parquet", []),
    "krang_lwa3": (
        "krang_lwa3/singlearm.urdf",
        "krang_lwa3/krang_lwa3_trainData.parquet",
        [
            Edit((*EFFORT, "kind"), "motor_current"),
            Edit((*EFFORT, "unit"), "A"),
            Edit((*EFFORT, "gain"), [18.71, 18.71, 23.75, 23.75, 8.83, 8.83, 8.83]),
            Edit(("robot", "gravity"), [0.0, -9.81, 0.0]),
        ],
    ),
    "naruton6": (
        "naruton6/naruton6.urdf",
        "naruton6/naruton6_traj1.parquet",
        [Edit((*EFFORT, "kind"), "joint_torque"), Edit((*EFFORT, "gain"), COUNTS.tolist())],
    ),
    "kinova_gen3": (
        "kinova_gen3/gen3.urdf",
        "kinova_gen3/RunTrajectory1.parquet",
        [Edit((*EFFORT, "columns"), [f"TorqueCur{j}" for j in range(1, 8)])],
    ),
}
"""Model file, log, and what the data's README says of them, of robots without a robot file."""
ROBOTS = (*LOGS, *OTHERS)
LATE = 0.1  # delay that is planted [s]
GRAVITY = 9.81
Table = pl.DataFrame
Random = np.random.Generator


@dataclass(frozen=True, eq=False)
class Given:
    """A robot's file and log, as they are right."""

    subject: Subject
    log: str  # path
    window: str

    @cached_property
    def columns(self) -> dict[str, list[str]]:
        """Names of the columns of positions, velocities and efforts."""
        signals = self.subject.signals
        own = ("position", "velocity", "effort")
        return {key: list(getattr(signals, key) or ()) for key in own}


def given(robot: str) -> Given:
    """One of the robots."""
    model, log, edits = OTHERS.get(robot) or (EXAMPLES / f"{robot}.toml", LOGS.get(robot), [])
    path, _, window = str(data_folder() / str(log)).partition("@")
    subject = subject_of(str(data_folder() / model), log_files([path])[0])
    if robot in OTHERS:
        edits = [*edits, Edit(("robot", "urdf"), str(data_folder() / model))]
    text = edited(subject.text, edits)
    loaded = load_robot(subject.path, text)
    return Given(replace(subject, text=text, loaded=loaded), path, window)


@dataclass(frozen=True, eq=False)
class Planted:
    """A mistake."""

    change: Callable[[Table], Table] = lambda table: table
    joints: tuple[int, ...] = ()  # of which alone it may be said; of any if empty
    gravity: list[float] | None = None  # in the robot file instead


def times(one: Given, keys: Sequence[str], factor: float, joints: Sequence[int]) -> Planted:
    """Columns of some joints times a factor."""
    names = [one.columns[key][j] for key in keys if one.columns[key] for j in joints]
    return Planted(
        lambda table: table.with_columns(*((factor * pl.col(x)).alias(x) for x in names)),
        tuple(joints),
    )


def exchanged(one: Given, keys: Sequence[str], a: int, b: int) -> Planted:
    """Columns of two joints exchanged."""
    pairs = [(one.columns[key][a], one.columns[key][b]) for key in keys if one.columns[key]]
    both = [(x, y) for pair in pairs for x, y in (pair, pair[::-1])]
    return Planted(lambda t: t.with_columns(*(pl.col(x).alias(y) for x, y in both)), (a, b))


def delayed(one: Given) -> Planted:
    """Efforts logged late."""

    def change(table: Table) -> Table:
        signals = one.subject.signals
        step = float(np.median(np.diff(table[signals.time].to_numpy()))) * signals.time_scale
        rows = round(LATE / step)
        return table.with_columns(
            *(pl.col(x).shift(rows).backward_fill() for x in one.columns["effort"])
        )

    return Planted(change)


def mounted(one: Given, rng: Random) -> Planted:
    """Gravity across the true one in the robot file."""
    down = np.asarray(one.subject.loaded.robot.gravity)
    across = [x for x in (*np.eye(3), *-np.eye(3)) if abs(x @ down) < 0.5 * GRAVITY]
    return Planted(gravity=(GRAVITY * across[int(rng.integers(len(across)))]).tolist())


MOTION = ("position", "velocity")
KINDS: dict[str, tuple[Callable[[Given, int, int, Random], Planted], str]] = {
    "effort sign": (lambda g, a, b, r: times(g, ["effort"], -1.0, [a]), "effort sign"),
    "position sign": (lambda g, a, b, r: times(g, MOTION, -1.0, [a]), "position sign"),
    "joints exchanged": (
        lambda g, a, b, r: exchanged(g, (*MOTION, "effort"), a, b),
        "joint order",
    ),
    "efforts exchanged": (lambda g, a, b, r: exchanged(g, ["effort"], a, b), "joint order"),
    "thousandths": (
        lambda g, a, b, r: times(g, ["effort"], 1e3, range(len(g.columns["effort"]))),
        "effort unit, effort kind, gain",
    ),
    "gain of one": (
        lambda g, a, b, r: times(g, ["effort"], 2.2, [a]),
        "effort unit, effort kind, gain",
    ),
    "late": (lambda g, a, b, r: delayed(g), "effort delay"),
    "mounting": (lambda g, a, b, r: mounted(g, r), "mounting"),
}
"""How a mistake is planted, and the checks that may call it wrong."""
PAIRS = ("effort sign, late", "joints exchanged, thousandths", "mounting, gain of one")
CLEAN = "nothing"
TRUE = {"krang_lwa3": {"clock", "repeats", "saturation"}}
"""Checks whose doubts the data's README confirms: rows 10 to 33 ms apart, of which 23 % repeat."""


def judged(
    found: CheckResult, planted: dict[str, Planted], joints: Sequence[str], true: Container[str]
) -> str:
    """A word for what is said of a log; what checks named in `true` find is so."""
    fixed = found.fixed
    changes = [] if fixed is None else list(fixed.changes)
    findings = [*found.content.diagnosis.findings, *(c.finding for c in changes)]
    wrong = [f for f in findings if f.severity is Severity.WRONG]

    def of(f: Finding) -> list[str]:
        return [
            name
            for name, one in planted.items()
            if f.check in KINDS[name][1].split(", ")
            and (not one.joints or set(f.joints) <= {joints[j] for j in one.joints})
        ]

    if any(not of(c.finding) for c in changes):
        return "wrong fix"
    if any(not of(f) for f in wrong):
        return "false reason"
    if not planted:
        return "doubt" if any(f.severity and f.check not in true for f in findings) else "right"
    named = {name for f in findings if f.severity for name in of(f)}
    open_ = {f.check for f in findings if not f.answered}
    left = [x for x in planted if x not in named]
    if not left:
        return "right"
    unsaid = [x for x in left if not open_ & set(KINDS[x][1].split(", "))]
    return "missed" if unsaid and not any(f.severity for f in findings) else "open"


def one(robot: str, kinds: str, seed: int) -> dict[str, Any]:
    """The verdict on one log."""
    own, rng, planted = given(robot), np.random.default_rng(seed), dict[str, Planted]()
    table, text = pl.read_parquet(own.log), own.subject.text
    for name in kinds.split(", ") if kinds != CLEAN else ():
        a, b = rng.choice(len(own.columns["effort"]), 2, replace=False)
        planted[name] = KINDS[name][0](own, int(a), int(b), rng)
        table = planted[name].change(table)
        if (gravity := planted[name].gravity) is not None:
            text = edited(text, [Edit(("robot", "gravity"), gravity)])
    with tempfile.TemporaryDirectory() as folder:
        file, log = Path(folder) / "robot.toml", Path(folder) / "log.parquet"
        file.write_text(text)
        table.write_parquet(log)
        window = own.window and f"@{own.window}"
        found = check(file, f"{log}{window}", quick=True, fix=Path(folder) / "fixed.toml")
    joints = own.subject.loaded.robot.joint_names
    said = [f"{f.word} {f.check}: {f.says}" for f in found.content.diagnosis.findings if f.severity]
    verdict = judged(found, planted, joints, TRUE.get(robot, ()))
    return {"robot": robot, "planted": kinds, "verdict": verdict, "said": said}


def main(robots: Sequence[str] = ROBOTS) -> list[Claim]:
    """All robots with every mistake, and with pairs of them."""
    lines = []
    for robot in robots:
        for number, kinds in enumerate((CLEAN, *KINDS, *PAIRS)):
            lines.append(one(robot, kinds, number))
            print(json.dumps(lines[-1]), file=sys.stderr, flush=True)
    of, n = Counter(line["verdict"] for line in lines), len(lines)
    good = of["right"] + of["open"] + of["doubt"]
    clean = Counter(line["verdict"] for line in lines if line["planted"] == CLEAN)
    return [
        Claim(
            f"{n} logs of real robots with planted mistakes: right or open",
            f"{good}, {of['right']} of them right",
            ">= 97 %",
            good >= 0.97 * n,
        ),
        Claim("wrong fixes", f"{of['wrong fix']}", "0", not of["wrong fix"]),
        Claim("false reasons called wrong", f"{of['false reason']}", "0", not of["false reason"]),
        Claim(
            "logs as they are: called wrong, doubtful",
            f"{clean['false reason'] + clean['wrong fix']}, {clean['doubt']}",
            "0, 0",
            clean["right"] == len(robots),
        ),
    ]


if __name__ == "__main__":
    main_of(lambda: main(sys.argv[1:] or ROBOTS))

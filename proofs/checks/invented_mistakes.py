"""Invented robots x mistakes: what `check` says of them, and what `--fix` would write.

Every seed draws a robot, its model file (off by 5 to 300 %), drives, sensors, one to three logs and
none, one or two mistakes; Pinocchio makes the torques. A seed is *right* if the planted mistakes
are called wrong, with their joints; *open* if the words are doubtful or open; *missed* if no error
was found and nothing is open that the mistake concerns; *wrong reason* if anything else is called
wrong; *wrong fix* if `--fix` would write what no planted mistake asks for; *refused* if a clean log
is called wrong. Passing contacts are left to `identify`, whose notes must name them. What is called
wrong is stated as beyond doubt: of that, 98 % must be right.

Seeds 1 to 100 may be used to set thresholds, 101 to 300 only for the figure. `--seeds 101-300`;
`--out FILE` gets a line per seed, and seeds in it are not run again; `--keep FOLDER` keeps files.
"""

import argparse
import json
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from proofs.checks.clean_logs import nominal
from proofs.support import invented_plants as invented
from proofs.support.claims import Claim, main_of
from proofs.support.faults import joint_values
from proofs.support.invented_plants import Plant, Random
from proofs.support.mistakes import Log
from proofs.support.safety_robots import Arm, arm_urdf

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.check.check import CheckResult, check
from steelyard.check.finding import Finding, Severity
from steelyard.check.findings_text_and_page import check_headline
from steelyard.identify.identify import identify
from steelyard.robot.file.robot_file import LoadedRobot, load_robot

COLUMNS = ("time_s", "q{}", "dq{}", "tau{}")


@dataclass(frozen=True, eq=False)
class Planted:
    """What a mistake makes of a robot, of its model file, and of its logs."""

    change: Callable[[Log], Log] = lambda log: log  # of the logs
    joints: tuple[int, ...] = ()  # that it concerns; none: all, or no joint
    plant: dict[str, Any] = field(default_factory=dict)  # what is otherwise of the robot
    model: Arm | None = None  # the bodies that the model file is drawn from
    late: float = 0.0  # by how much efforts are late [s]


def on(key: str, change: Callable[[Array], Array], *joints: int) -> Planted:
    """Another `tau`; or `q`, with velocities."""

    def changed(log: Log) -> Log:
        if key == "tau":
            return replace(log, tau=change(log.tau))
        return replace(log, q=change(log.q), dq=None if log.dq is None else change(log.dq))

    return Planted(changed, joints)


def off(key: str, plant: Plant, j: int, factor: float) -> Planted:
    factors = np.where(np.arange(plant.n) == j, factor, 1.0)
    return on(key, lambda x: x * factors, j)


def swapped(key: str, plant: Plant, j: int, rng: Random) -> Planted:
    order, other = np.arange(plant.n), int(rng.choice(np.delete(np.arange(plant.n), j)))
    order[[j, other]] = other, j
    return on(key, lambda x: x[:, order], j, other)


def late(plant: Plant, j: int, rng: Random) -> Planted:
    by = float(np.exp(rng.uniform(np.log(0.001), np.log(0.04))))

    def change(log: Log) -> Log:
        return replace(log, tau=np.array([np.interp(log.t - by, log.t, x) for x in log.tau.T]).T)

    return Planted(change, late=by)


def mounted(plant: Plant, j: int, rng: Random) -> Planted:
    """The base hangs, is at a wall, or is tilted by 20 degrees or more."""
    walls = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    way = np.append(rng.standard_normal(2), 0.0)
    way[2] = rng.uniform(-2.5, 1.0) * np.linalg.norm(way)
    way = walls[rng.integers(3)] if rng.random() < 0.6 else way / np.linalg.norm(way)
    return Planted(plant={"gravity": 9.81 * way})


def loaded(plant: Plant, rng: Random, *, tool: bool) -> Planted:
    """A payload of 5 to 30 % of the robot's mass, or such a tool that is only in the model file."""
    mass = rng.uniform(0.05, 0.3) * float(np.sum(plant.of_joints("mass")))
    arm = invented.carrying(plant.arm, mass, rng.uniform(-0.05, 0.15, 3))
    return Planted(model=arm) if tool else Planted(plant={"arm": arm}, model=plant.arm)


def dead(plant: Plant, j: int, rng: Random) -> Planted:
    here, value = np.arange(plant.n) == j, float(rng.choice([0.0, 1.7]))
    return on("tau", lambda x: np.where(here, value, x), j)


def zero(plant: Plant, j: int, rng: Random) -> Planted:
    """A zero elsewhere, of a joint that is neither the first nor the last."""
    j = int(rng.integers(1, plant.n - 1))
    by = np.deg2rad(rng.choice([5.0, 10.0, 20.0, -30.0, 45.0, 90.0, -90.0]))
    shift = np.where(np.arange(plant.n) == j, by, 0.0)
    return Planted(lambda log: replace(log, q=log.q + shift), (j,))


def geared(plant: Plant, j: int, rng: Random) -> Planted:
    """A log with another ratio than the robot file states."""
    factor = plant.ratios[j] / round(plant.ratios[j] * rng.uniform(1.3, 2.2) ** rng.choice([-1, 1]))
    efforts, turns = off("tau", plant, j, factor), off("q", plant, j, 1.0 / factor)
    if not plant.motors:
        return efforts
    return replace(efforts, change=lambda log: turns.change(efforts.change(log)))


def touched(plant: Plant, j: int, rng: Random) -> Planted:
    """Something pushes the last link for a while, with 10 to 50 % of the robot's weight."""
    weight, way = 9.81 * float(np.sum(plant.of_joints("mass"))), rng.standard_normal(3)
    return Planted(plant={"push": 4.0 * rng.uniform(0.1, 0.5) * weight * way / np.linalg.norm(way)})


def counted(plant: Plant, j: int, rng: Random) -> Planted:
    factor = rng.uniform(10.0, 60.0)
    return on("tau", lambda x: factor * x)


def motor_side(plant: Plant, j: int, rng: Random) -> Planted:
    ratios = rng.integers(50, 161, plant.n)
    return on("tau", lambda x: x / ratios)


def clocked(plant: Plant, j: int, rng: Random) -> Planted:
    factor = float(rng.uniform(1.1, 2.0) ** rng.choice([-1.0, 1.0]))
    return Planted(lambda log: replace(log, t=log.t * factor))


ARMS = "6R 7R heavy low-cost"
GEARLESS = "6R SCARA gantry 7R low-cost"
ANY = f"{GEARLESS} heavy"
SCALE = "effort unit, effort kind, gain, transmission"
DEAD = "noise, computed efforts, saturation, signed efforts"
KINDS: dict[str, tuple[Callable[[Plant, int, Random], Planted], str, str]] = {
    "positions swapped": (lambda p, j, r: swapped("q", p, j, r), "joint order", ANY),
    "efforts swapped": (lambda p, j, r: swapped("tau", p, j, r), "joint order", ANY),
    "position sign": (lambda p, j, r: off("q", p, j, -1.0), "position sign", ANY),
    "effort sign": (lambda p, j, r: off("tau", p, j, -1.0), "effort sign", ANY),
    "sign of all efforts": (lambda p, j, r: on("tau", lambda x: -x), "effort sign", ANY),
    "degrees": (
        lambda p, j, r: on("q", lambda x: np.where(p.turning, np.rad2deg(x), x)),
        "position, velocity",
        f"{ARMS} SCARA",
    ),
    "mNm or mA": (lambda p, j, r: on("tau", lambda x: 1e3 * x), SCALE, ANY),
    "counts": (counted, SCALE, ANY),
    "motor side": (motor_side, SCALE, GEARLESS),
    "gain of one": (lambda p, j, r: off("tau", p, j, r.choice([0.5, 2.2])), SCALE, ANY),
    "delay": (late, "effort delay", ANY),
    "clock": (clocked, "clock", ANY),
    "zero": (zero, "joint zeros", ARMS),
    "mounting": (mounted, "mounting", ANY),
    "payload": (lambda p, j, r: loaded(p, r, tool=False), "payload", ANY),
    "tool removed": (lambda p, j, r: loaded(p, r, tool=True), "payload", ANY),
    "dead effort": (dead, DEAD, ANY),
    "contact": (touched, "contact", ANY),
    "gear ratio": (geared, f"{SCALE}, position", "heavy"),
    "gravity compensated": (
        lambda p, j, r: Planted(plant={"compensates": "gravity"}),
        "effort kind",
        ARMS,
    ),
}
"""How a mistake is planted, the checks that may call it wrong, and in which robots it is drawn."""


ROBOT_FILE = """\
[robot]
urdf = "robot.urdf"
{gears}
[model]
terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]

[signals]
time = "time_s"
position = "q{{}}"
{velocity}
coordinates = "{coordinates}"

[signals.effort]
columns = "tau{{}}"
kind = "{kind}"
side = "{side}"
unit = {unit}
gain = {gain}
"""
EFFORTS = {
    "heavy": ("motor_torque", "motor", '"Nm"'),
    "6R": ("motor_current", "joint", '"A"'),
    "low-cost": ("motor_current", "joint", '"%"'),
}


def robot_file(plant: Plant, gains: Array, *, velocities: bool) -> str:
    """The truth, but for what is planted."""
    units = json.dumps(["Nm" if x else "N" for x in plant.turning])
    kind, side, unit = EFFORTS.get(plant.family, ("joint_torque", "joint", units))
    return ROBOT_FILE.format(
        gears=f"[robot.transmission]\nratios = {plant.ratios.tolist()}" if side == "motor" else "",
        velocity='velocity = "dq{}"' if velocities else "",
        coordinates="motor" if plant.motors else "joint",
        **{"kind": kind, "side": side, "unit": unit, "gain": gains.tolist()},
    )


@dataclass(frozen=True, eq=False)
class Case:
    """A seed's files, and the truth."""

    plant: Plant
    planted: dict[str, Planted]
    off: float  # error of the model file
    robot: Path
    logs: tuple[Path, ...]
    partly: list[Log]  # the first log as given, and without one or all mistakes, as logged


def written(seed: int, folder: Path) -> Case:
    """The files of a seed."""
    rng = np.random.default_rng([20_261_127, seed])
    plant, model, planted = invented.drawn_plant(rng), None, dict[str, Planted]()
    names = [name for name, (*_, families) in KINDS.items() if plant.family in families.split()]
    for name in rng.choice(names, rng.choice([0, 1, 2], p=[0.25, 0.55, 0.2]), replace=False):
        one = KINDS[name][0](plant, int(rng.integers(plant.n)), rng)
        plant, model = replace(plant, **one.plant), one.model or model
        planted[str(name)] = one
    off = float(np.exp(rng.uniform(np.log(0.05), np.log(3.0))))
    sensors = invented.drawn_sensors(rng, plant.family)
    count, clean = int(rng.choice([1, 2, 3], p=[0.65, 0.25, 0.1])), list[Log]()
    for _ in range(count):
        seconds, moves = rng.uniform(20.0, 60.0) / count, bool(rng.random() < 0.4)
        motion = invented.drawn_motion(rng, plant, seconds, sensors.rate, moves=moves)
        largest = np.abs(clean[0].tau).max(axis=0) if clean else None
        clean.append(invented.logged(plant, sensors, motion, largest, rng))
    most = {"6R": 12.0, "low-cost": sensors.coarse}.get(plant.family, 0.0)
    gains = np.abs(clean[0].tau).max(axis=0) / most if most else np.ones(plant.n)
    turns = plant.ratios if plant.motors else np.ones(plant.n)
    raw = [
        on("q", lambda x: x * turns).change(replace(x, tau=x.tau / gains / plant.ratios))
        for x in clean
    ]
    robot, bodies = folder / "robot.toml", nominal(model or plant.arm, off, rng)
    robot.with_suffix(".urdf").write_text(arm_urdf(bodies))
    robot.write_text(robot_file(plant, gains, velocities=sensors.velocities))
    changes = [one.change for one in planted.values()]
    logs = tuple(folder / f"log{k + 1}.parquet" for k in range(count))
    for path, log in zip(logs, raw, strict=True):
        reduce(_then, changes, log).write(path, COLUMNS)
    partly = [changes, [], *([c] for c in changes)]
    return Case(plant, planted, off, robot, logs, [reduce(_then, some, raw[0]) for some in partly])


def _then(log: Log, change: Callable[[Log], Log]) -> Log:
    return change(log)


def read(loaded: LoadedRobot, log: Log) -> list[Array]:
    """Span of time, positions, efforts and velocities of each joint, as a robot file reads them."""
    columns = {"q": log.q, "tau": log.tau} | ({} if log.dq is None else {"dq": log.dq})
    names = [f"{key}{j + 1}" for key, x in columns.items() for j in range(x.shape[1])]
    rows = np.column_stack([log.t, *columns.values()])
    t, q, dq, tau = joint_values(("time_s", *names), rows, loaded)
    return [np.array([np.ptp(t)]), *q.T, *tau.T, *([] if dq is None else dq.T)]


def near(a: Array, b: Array, by: float) -> bool:
    """Whether an array is another one, to a relative tolerance."""
    return float(np.linalg.norm(a - b)) <= by * float(np.linalg.norm(b)) + 1e-9


def strayed(case: Case, text: str) -> list[str]:
    """What a corrected robot file reads otherwise than the given one, without a planted reason."""
    given, new, n = load_robot(case.robot), load_robot(case.robot, text), case.plant.n
    before, *truths = (read(given, log) for log in case.partly)
    after, bounds = read(new, case.partly[0]), [0.02, *[0.03] * n, *[0.15] * n, *[0.05] * n]
    names = ["time", *(f"{key}{j + 1}" for key in ("q", "tau", "dq") for j in range(n))]
    bad = [
        name
        for name, by, x, y, *each in zip(names, bounds, after, before, *truths, strict=False)
        if not near(x, y, 1e-6) and not any(near(x, z, by) for z in each)
    ]
    gravity, weightless = new.robot.gravity, "gravity compensated" in case.planted
    if not any(near(gravity, x, 0.1) for x in (given.robot.gravity, case.plant.gravity)):
        bad += ["gravity"] * (gravity.any() or not weightless)
    if new.signals is not None:
        late = max((one.late for one in case.planted.values()), default=0.0)
        delay, kind = new.signals.effort_delay, new.signals.effort_kind
        bad += ["delay"] * bool(delay and abs(delay - late) > max(5e-4, 0.15 * late))
        bad += ["kind"] * (kind == "gravity_compensated_torque" and not weightless)
    return bad


def named(case: Case, f: Finding) -> list[str]:
    """The mistakes that a finding calls wrong: by their checks, at none but their joints."""
    return [
        name
        for name, one in case.planted.items()
        if f.check in KINDS[name][1].split(", ")
        and (not one.joints or set(f.joints) <= {f"j{j + 1}" for j in one.joints})
    ]


def verdict(case: Case, found: CheckResult) -> tuple[str, list[str]]:
    """The word for a seed, and what is called wrong, each with whether that is true."""
    fixed, last = found.fixed, found.last
    changes = [] if fixed is None else [c.finding for c in fixed.changes]
    findings = [*found.content.diagnosis.findings, *changes, *last.findings]
    wrong = [f for f in findings if f.severity == Severity.WRONG]
    # a doubt that was acted on is no doubt any more: lines that stray are judged below
    true = {name for f in (*wrong, *changes) for name in named(case, f)}
    if "contact" in case.planted and not wrong and force_named(case):
        true.add("contact")
    sure = [f"{'true' if named(case, f) else 'false'} {f.check}: {f.says}" for f in wrong]
    stated = list({line.split(":")[0]: line for line in sure}.values())
    if fixed and fixed.changes and (bad := strayed(case, fixed.subject.text)):
        return f"wrong fix ({', '.join(bad)})", stated
    if any(line.startswith("false") for line in stated):
        return "wrong reason" if case.planted else "refused", stated
    doubtful = bool(last.severity) or check_headline(last).startswith("Open")
    if true == set(case.planted):
        return "open" if not case.planted and doubtful else "right", stated
    asked = {f.check for f in last.findings if not f.answered}
    unseen = [
        name
        for name in case.planted
        if name not in true
        and not asked & set(KINDS[name][1].split(", "))
        and not conditional(case, name)
        and not (name == "delay" and below_bound(case.planted[name].late, last.findings))
    ]
    return ("open" if doubtful or not unseen else f"missed ({', '.join(unseen)})"), stated


def force_named(case: Case) -> bool:
    """Whether `identify` leaves a stretch out in which a force passes."""
    try:
        found = identify(case.robot, case.logs)
    except SteelyardError:
        return False
    return any("a force acts" in note for note in found.content.notes)


def below_bound(late: float, findings: Sequence[Finding]) -> bool:
    """Whether a delay is shorter than those that a check excludes, by its own words."""
    said = [re.search(r"no common delay of ([\d.]+) ms or more", f.says) for f in findings]
    return any(one is not None and 1e3 * late < float(one[1]) for one in said)


def conditional(case: Case, name: str) -> bool:
    """Whether no load is seen, if the model file's masses are right, and they are not."""
    return name == "tool removed" or (name == "payload" and case.off > 0.2)


def one(seed: int, folder: Path) -> dict[str, Any]:
    """What comes of a seed."""
    case, start = written(seed, folder), time.process_time()
    joints = {name: [f"j{j + 1}" for j in one.joints] for name, one in case.planted.items()}
    line: dict[str, Any] = {"seed": seed, "mistakes": joints, "family": case.plant.family}
    line |= {"off": round(case.off, 2), "law": case.plant.law, "stated": [], "verdict": "crash"}
    try:
        found = check(case.robot, case.logs, fix="")
        line["verdict"], line["stated"] = verdict(case, found)
        line["says"] = check_headline(found.last)
        line["changes"] = [c.line for c in found.fixed.changes] if found.fixed else []
        doubts = [f for f in found.last.findings if f.severity == Severity.DOUBTFUL]
        line["doubts"] = [f"{f.check}: {f.says}" for f in doubts]
        line["open"] = found.last.open_checks
    except SteelyardError as error:
        line |= {"verdict": "refused" if not joints else "open", "says": str(error)}
    except Exception as error:
        line["says"] = f"{type(error).__name__}: {error}"
    return line | {"seconds": round(time.process_time() - start, 1)}


def table(lines: Sequence[dict[str, Any]]) -> str:
    """How many seeds of every kind of mistake had which verdict."""
    words = ("right", "open", "missed", "wrong reason", "wrong fix", "refused", "crash")
    rows = {name: Counter[str]() for name in (*KINDS, "none", "two mistakes", "all")}
    for line in lines:
        kinds = list(line["mistakes"]) or ["none"]
        for name in [*kinds, *["two mistakes"] * (len(kinds) == 2), "all"]:
            rows[name][line["verdict"].split(" (")[0]] += 1
    text = [f"{'':<20}" + "".join(f"{word:>13}" for word in words)]
    for name, row in rows.items():
        text.append(f"{name:<20}" + "".join(f"{row[word] or '':>13}" for word in words))
    return "\n".join(text)


def claims(lines: Sequence[dict[str, Any]]) -> list[Claim]:
    """The figures with their bounds."""
    of = Counter(line["verdict"].split(" (")[0] for line in lines)
    good, false = of["right"] + of["open"], of["wrong reason"] + of["refused"]
    stated = [one for line in lines for one in line["stated"]]
    true, least = sum(one.startswith("true") for one in stated), 0.98 * len(stated)
    name, n = f"{len(lines)} invented robots", len(lines)
    said = f"{good}, {of['right']} of them right"
    return [
        Claim(f"{name}: right or rightly open", said, ">= 97 %", good >= 0.97 * n),
        Claim(f"{name}: wrong fixes", f"{of['wrong fix']}", "0", not of["wrong fix"]),
        Claim(f"{name}: confident false reasons", f"{false}", "<= 0.5 %", false <= 0.005 * n),
        Claim(f"{name}: clean logs refused", f"{of['refused']}", "0", not of["refused"]),
        Claim("what is called wrong is so", f"{true} of {len(stated)}", ">= 98 %", true >= least),
    ]


def main(
    seeds: Sequence[int] = range(101, 301), out: Path | None = None, keep: Path | None = None
) -> list[Claim]:
    """All seeds, one after the other."""
    before = out.read_text().splitlines() if out is not None and out.exists() else []
    lines = {line["seed"]: line for line in map(json.loads, before)}
    for seed in sorted(set(seeds) - set(lines)):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) if keep is None else keep / str(seed)
            folder.mkdir(parents=True, exist_ok=True)
            lines[seed] = one(seed, folder)
        text = json.dumps(lines[seed])
        print(text, file=sys.stderr, flush=True)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(text + "\n")
    chosen = [line for seed, line in lines.items() if seed in seeds]
    print(table(chosen), file=sys.stderr)
    return claims(chosen)


def requested() -> list[Claim]:
    """As the command line asks."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", default="101-300")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    return main(range(int(first), int(last or first) + 1), options.out, options.keep)


if __name__ == "__main__":
    main_of(requested)

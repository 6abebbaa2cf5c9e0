"""A user of each kind: `init`, `check`, `identify` on the command line, with the edits it proposes.

Each user has a log in the format that such a robot's logs come in, and no robot file. The error on
motion that was not fitted is compared with that of the hand-made robot file in `examples/`, from
the same logs and in the same band of frequencies. Edits are those that the terminal proposes; what
nobody can read from a log (gear ratios, torque constants) is stated as from a data sheet.
"""

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import scipy.io
from proofs.robots.scores import EXAMPLES
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.log_files import bag_writers

WITHIN = 1.05
"""Error over that of the hand-made robot file."""
DRIVER = (2, 1, 0, 3, 4, 5)
"""Joints of a UR10e in the order of its ROS 2 driver's joint states: elbow first."""


@dataclass(frozen=True)
class Edit:
    """A line of the robot file that a user changes.

    Attributes:
        source: Who says so: words of the terminal, or `data sheet`.
        pattern: What is replaced, a regular expression over lines.
        value: By what.
    """

    source: str
    pattern: str
    value: str


BEHIND_GEARS = (
    Edit("init: sensors", '(?m)^kind = "joint_torque"', 'kind = "link_torque"'),
    Edit("init: sensors", '"rotor_inertia", ', ""),
)
"""What the terminal proposes for torque sensors on the link side."""


@dataclass(frozen=True)
class User:
    """A kind of user.

    Attributes:
        name: Name.
        urdf: Robot model.
        fit: Logs to fit.
        unseen: Log to predict.
        hand: Name of the hand-made robot file.
        hand_fit: The same logs as that file reads them.
        hand_unseen: Likewise.
        incomplete: Words of the terminal, where `init` says that the file is incomplete.
        edits: What the user changes after `init`.
    """

    name: str
    urdf: Path
    fit: tuple[str, ...]
    unseen: str
    hand: str
    hand_fit: tuple[str, ...]
    hand_unseen: str
    incomplete: str = ""
    edits: tuple[Edit, ...] = ()


def universal_robots(folder: Path) -> User:
    """A UR10e with logs of its RTDE recorder."""
    data = data_folder() / "ur10e"
    names = ("ur-20_02_12-40sec_12harm", "ur-20_02_19_14harm50sec")
    logs = [data / "identification" / f"{name}.parquet" for name in names]
    unseen = data / "validation" / "ur-20_01_17-ptp_10_points.parquet"
    renamed = {"time_s": "timestamp"}
    for here, there in (
        ("q{}_rad", "actual_q_{}"),
        ("dq{}_rad_s", "actual_qd_{}"),
        ("current{}_A", "actual_current_{}"),
        ("current_des{}_A", "target_current_{}"),
        ("tau_des{}_Nm", "target_moment_{}"),
    ):
        renamed |= {here.format(k): there.format(k - 1) for k in range(1, 7)}

    def written(path: Path) -> str:
        frame = pl.read_parquet(path).rename(renamed, strict=False)
        frame.write_csv(folder / f"{path.stem}.csv", separator=" ")
        return str(folder / f"{path.stem}.csv")

    return User(
        "UR10e, RTDE CSV",
        data / "ur10e.urdf",
        tuple(map(written, logs)),
        written(unseen),
        "ur10e_auto",
        tuple(map(str, logs)),
        str(unseen),
    )


def ros(folder: Path) -> User:
    """A UR10e with bags of joint states, joints in the driver's order, efforts in A."""
    data = data_folder() / "ur10e"
    log = data / "identification" / "ur-20_02_19_14harm50sec.parquet"
    unseen = data / "validation" / "ur-20_01_17-ptp_10_points.parquet"
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    names = [f"{joints[k]}_joint" for k in DRIVER]

    def written(path: Path) -> str:
        frame = pl.read_parquet(path)
        start = float(frame["time_s"][0])
        columns = ("q{}_rad", "dq{}_rad_s", "current{}_A")
        fields = [frame.select([c.format(k + 1) for k in DRIVER]).to_numpy() for c in columns]
        ns = np.round((frame["time_s"].to_numpy() - start) * 1e9).astype(int) + 10**18
        notes = [
            bag_writers.joint_state(int(t), names, *rows)
            for t, *rows in zip(ns, *fields, strict=True)
        ]
        return str(bag_writers.write_bag2(folder / path.stem, bag_writers.in_order(notes)))

    return User(
        "UR10e, ROS 2 bag",
        data / "ur10e.urdf",
        (written(log),),
        written(unseen),
        "ur10e_auto",
        (str(log),),
        str(unseen),
        edits=(
            Edit("check: currents", '(?m)^kind = "joint_torque"', 'kind = "motor_current"'),
            Edit("check: currents", '(?m)^unit = "Nm"', 'unit = "A"'),
            Edit(
                "data sheet",
                "(?m)^# gain = .*",
                "gain = [11.98, 11.98, 9.83, 10.76, 10.76, 10.76]",
            ),
        ),
    )


def matlab(folder: Path) -> User:
    """A Rokae AR5 on its side, with structs of MATLAB.

    Its example states another direction of gravity than `check --fix` finds, half a degree aside.
    With the example's direction scales of the efforts predict better, with the other one they do
    not.
    """
    data = data_folder() / "rokae_ar5"
    log = data / "ar5_run1_rows0_2300.parquet"
    frame = pl.read_parquet(log)

    def written(name: str, start: float, stop: float) -> str:
        t = pl.col("time_s") - frame["time_s"][0]
        part = frame.filter((t >= start) & (t < stop))
        struct = {"t": part["time_s"].to_numpy()}
        for field, column in (("q", "q{}_rad"), ("dq", "dq{}_rad_s"), ("tau", "tau{}_Nm")):
            struct[field] = part.select([column.format(k) for k in range(1, 8)]).to_numpy()
        scipy.io.savemat(folder / f"{name}.mat", {"data": struct})
        return str(folder / f"{name}.mat")

    return User(
        "Rokae AR5, MATLAB struct",
        data / "ar5.urdf",
        (written("fit", 0.0, 34.0),),
        written("unseen", 34.0, 45.0),
        "rokae_ar5_auto",
        (f"{log}@0:34",),
        f"{log}@34:45",
        edits=BEHIND_GEARS,
    )


def motors(_: Path) -> User:
    """A TX40, logged on the motors' side."""
    data = data_folder() / "tx40"
    log = data / "tx40_run1.parquet"
    fit, unseen = f"{log}@0.1:5.2", f"{log}@5.2:7.5"
    ratios = "[32.0, 32.0, 45.0, -48.0, 45.0, 32.0]"
    zeros = "[0.0, -1.5707963267948966, 1.5707963267948966, 0.0, 0.0, 0.0]"
    return User(
        "TX40, motor side",
        data / "tx40.urdf",
        (fit,),
        unseen,
        "tx40",
        (fit,),
        unseen,
        incomplete="the gear ratios are unknown",
        edits=(
            Edit("init: remove the #", r"(?m)^# \[robot.transmission\]", "[robot.transmission]"),
            Edit("data sheet", "(?m)^# ratios = .*", f"ratios = {ratios}"),
            Edit("data sheet", r"(?m)^# coupling = (.*)\?\}\]", r"coupling = \g<1>32.0}]"),
            Edit("init: coupling", r"(?m)^  # (\{law = .*motors = .*)", r"  \1"),
            Edit("data sheet", "(?m)^# position_offset = .*", f"position_offset = {zeros}"),
        ),
    )


def currents(_: Path) -> User:
    """A TIAGo with motor currents."""
    data = data_folder() / "tiago"
    log = data / "tiago_run1_rows0_5600.parquet"
    fit, unseen = f"{log}#921:4443", f"{log}#4443:5600"
    kept = "|".join(f"arm_{k}_joint" for k in (5, 6, 7))
    limits = rf"(?ms)^\[robot.limits.({kept})\]\n.*?(?=^\[|\n\n)"
    listed = r'"q_torso_m", "q_arm1_rad", "q_arm2_rad", "q_arm3_rad", "q_arm4_rad"'
    efforts = '"effort_torso_raw", ' + ", ".join(f'"current_arm{k}_A"' for k in range(1, 5))
    return User(
        "TIAGo, currents",
        data / "tiago_48_schunk.urdf",
        (fit,),
        unseen,
        "tiago",
        (fit,),
        unseen,
        incomplete="the log has no columns of head_1_joint",
        edits=(
            Edit("check: leave joints out", rf'(?m)^  "({kept})",\n', ""),
            Edit("check: leave joints out", r"(?m)^\[robot.locked\]",
                 "[robot.locked]\narm_5_joint = -0.65\narm_6_joint = 0.16\narm_7_joint = 0.06"),
            Edit("check: leave joints out", limits, ""),
            Edit("check: leave joints out", "(?m)^position = .*", f"position = [{listed}]"),
            Edit("check: leave joints out", "(?m)^columns = .*", f"columns = [{efforts}]"),
            Edit("check: leave joints out", "(?m)^position_unit = .*",
                 'position_unit = ["m", "rad", "rad", "rad", "rad"]'),
            Edit("check: leave joints out", "(?m)^unit = .*", 'unit = ["N", "A", "A", "A", "A"]'),
            Edit("data sheet", "(?m)^gain = .*", "gain = [1.0, 13.6, 13.6, -8.7, -8.7]"),
        ),
    )  # fmt: skip


def torques(_: Path) -> User:
    """A Panda with torque sensors, which `init` knows to be on the link side."""
    data = data_folder() / "panda"
    log = data / "panda_gaz2019_trajectory1.parquet"
    fit, unseen = f"{log}@0.6:9.5", f"{log}@9.5:13.8"
    return User(
        "Panda, torque sensors",
        data / "panda_arm.urdf",
        (fit,),
        unseen,
        "panda",
        (fit,),
        unseen,
    )


USERS: tuple[Callable[[Path], User], ...] = (
    universal_robots,
    ros,
    matlab,
    motors,
    currents,
    torques,
)


@dataclass(frozen=True)
class Errors:
    """Errors of one model on unseen motion, where joints move [%].

    Pooled, or the mean over joints where their units differ.

    Attributes:
        chosen: Scales of the efforts estimated where the data ask for them, the default.
        given: With the gains that the robot file gives, no scales estimated.
        scaled: Whether scales were estimated.
    """

    chosen: float
    given: float
    scaled: bool


@dataclass(frozen=True)
class Outcome:
    """What a user obtains.

    Attributes:
        error: Errors on unseen motion.
        hand: The same with the hand-made robot file.
        said: Whether `init` said what is missing, where something is.
        fixes: Lines that `check --fix` wrote.
    """

    error: "Errors"
    hand: "Errors"
    said: bool
    fixes: tuple[str, ...]


def run(*words: object) -> subprocess.CompletedProcess[str]:
    """The command line."""
    command = [sys.executable, "-m", "steelyard", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True)


def outcome(user: User, folder: Path) -> Outcome:
    """One user's way from logs to an error."""
    robot = folder / "robot.toml"
    made = run("init", user.urdf, *user.fit, "-o", robot)
    first = made.stdout.splitlines()[0]
    said = (made.returncode, user.incomplete in first) == (1 if user.incomplete else 0, True)
    text = robot.read_text(encoding="utf-8")
    for edit in user.edits:
        text, count = re.subn(edit.pattern, edit.value, text)
        if not count:
            raise RuntimeError(f"{user.name}: the robot file has no line {edit.pattern!r}")
    robot.write_text(text, encoding="utf-8")
    fixed = folder / "fixed.toml"
    checked = json.loads(run("check", robot, *user.fit, "--fix", fixed, "--json").stdout)
    changes = (checked.get("fixed") or {}).get("changes", [])
    used = fixed if fixed.exists() else robot
    hand = EXAMPLES / f"{user.hand}.toml"
    band = re.search(r"(?m)^cutoff = .*", hand.read_text(encoding="utf-8"))
    scored = re.sub("(?m)^# cutoff = .*", band[0], used.read_text(encoding="utf-8"))  # type: ignore[index]
    used.write_text(scored, encoding="utf-8")
    return Outcome(
        error_of(used, user.fit, user.unseen),
        error_of(hand, user.hand_fit, user.hand_unseen),
        said,
        tuple(f"{'.'.join(c['path'])} = {c['value']}" for c in changes),
    )


def error_of(robot: Path, fit: Sequence[str], unseen: str) -> Errors:
    """Errors on unseen motion."""
    with tempfile.TemporaryDirectory() as folder:
        done = run(
            "identify", robot, *fit, "--validate", unseen, "-o", Path(folder) / "out", "--json"
        )
    if not done.stdout:
        raise RuntimeError(done.stderr)
    found = json.loads(done.stdout)
    chosen = _error(found["validation"][0])
    if found["effort_scales"] is None:
        return Errors(chosen, chosen, False)
    return Errors(chosen, _error(found["validation_without_scales"][0]), True)


def _error(score: dict[str, Any]) -> float:
    pooled = score["pooled_percent_moving"]
    return float(score["mean_percent_moving"] if pooled is None else pooled)


def claims(user: User, found: Outcome) -> Iterator[Claim]:
    """What is claimed of one user.

    Both models are compared as they are by default. Where scales of the efforts are estimated in
    one of them only, their errors are of different gains: they are compared with the gains given.
    """
    mine, hand = found.error, found.hand
    alike = mine.scaled == hand.scaled
    error, other = (mine.chosen, hand.chosen) if alike else (mine.given, hand.given)
    figure = f"{error:.2f} %"
    if not alike:
        figure += f" with the gains given; by default {mine.chosen:.2f} and {hand.chosen:.2f} %"
    bound = WITHIN * other
    words = f"<= {bound:.2f} % (1.05 x {user.hand}.toml)"
    yield Claim(f"{user.name}, error on unseen motion", figure, words, error <= bound)
    if user.incomplete:
        figure = "said first" if found.said else "not said first"
        yield Claim(f"{user.name}, init", figure, user.incomplete, found.said)


def main() -> list[Claim]:
    """All users, or those whose names contain an argument of `--only`."""
    only = sys.argv[sys.argv.index("--only") + 1] if "--only" in sys.argv else ""
    found: list[Claim] = []
    for kind in USERS:
        with tempfile.TemporaryDirectory() as folder:
            user = kind(Path(folder))
            if only not in user.name:
                continue
            result = outcome(user, Path(folder))
        print(
            f"{user.name}: {result.error.chosen:.2f} %, hand-made {result.hand.chosen:.2f} %; "
            "data sheet: "
            f"{sum(e.source == 'data sheet' for e in user.edits)} lines, proposed by the terminal: "
            f"{sum(e.source != 'data sheet' for e in user.edits)}, by check --fix: "
            f"{'; '.join(result.fixes) or 'none'}",
            file=sys.stderr,
            flush=True,
        )
        found += claims(user, result)
    return found


if __name__ == "__main__":
    main_of(main)

"""Checks of real logs of five robots and one more: true quirks are named, good files pass."""

import re
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.base.progress import silent
from steelyard.check.all_checks import Diagnosis, examine
from steelyard.check.case_from_files_and_precheck import case_of, subject_of
from steelyard.check.cases_and_checks import Case
from steelyard.check.finding import Finding, Severity
from steelyard.check.signals.motion_units import unit_reading
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_edits import edited
from steelyard.runs.runs_of_named_logs import log_files

EXAMPLES = Path(__file__).parents[2] / "examples"
LOGS = {
    "ur10e": "ur10e/identification/ur-20_02_12-40sec_12harm.parquet",
    "panda": "panda/panda_gaz2019_trajectory1.parquet",
    "rokae_ar5": "rokae_ar5/ar5_run1_rows0_2300.parquet",
    "tiago": "tiago/tiago_run1_rows0_5600.parquet",
    "tx40": "tx40/tx40_run1.parquet",
}
BROKEN_HEAD = "ur10e/identification/ur-19_09_27-11_32_02.parquet"
MOTOR_KEYS = (
    ("signals", "coordinates"),
    ("signals", "position_offset"),
    ("signals", "effort", "side"),
    ("robot", "transmission"),
    ("model", "terms"),
)
"""What the robot file of the TX40 says about motors."""

NEAR = 2.0
"""Tilt of the proposed gravity [deg] up to which it is that of the source."""

TRUE = {"excitation": "jointwise_motion/.*joint_[1-5]", "payload": "-load|Load"}
"""Checks that are right about some logs, and which."""


class Removed:
    """A key taken out of a robot file."""

    value = None

    def __init__(self, *path: str) -> None:
        self.path = path


def example_case(robot: str, log: str, *removed: tuple[str, ...]) -> Case:
    """A robot file of `examples/`, without some of its keys, and one log."""
    file = log_files([str(data_folder() / log)])
    subject = subject_of(str(EXAMPLES / f"{robot}.toml"), file[0])
    if removed:
        text = edited(subject.text, [Removed(*path) for path in removed])
        subject = replace(subject, text=text, loaded=load_robot(subject.path, text))
    return case_of(subject, file, None, silent)[0]


@cache
def good(robot: str) -> tuple[Case, Diagnosis]:
    """A robot file as it is, and what the quick checks say."""
    case = example_case(robot, LOGS[robot])
    return case, examine(case, quick=True)


def finding(diagnosis: Diagnosis, check: str) -> Finding:
    """The finding of one check about one log."""
    return next(f for f in diagnosis.findings if f.check == check)


def _passes(robot: str) -> Claim:
    _, diagnosis = good(robot)
    severities = [f"{f.check}: {f.severity.word}" for f in diagnosis.findings if f.severity]
    severities += ["inconclusive"] * diagnosis.inconclusive
    return Claim(
        f"quick check of {robot}",
        ", ".join(severities) or f"ok, {len(diagnosis.findings)} findings",
        "ok",
        diagnosis.severity == Severity.OK,
    )


def _clock() -> Claim:
    sentence = finding(good("ur10e")[1], "clock").says
    jitter = re.search(r"jitter ([\d.]+) ms", sentence)
    found = float(jitter.group(1)) if jitter else np.nan
    return Claim("jitter of UR10e", sentence, "steps of 10 and 12 ms named", 0.8 <= found <= 1.2)


def _rests() -> Claim:
    sentence = finding(good("ur10e")[1], "rests").says
    ends = [float(x) for x in re.findall(r"([\d.]+) s (?:of it )?at", sentence)]
    holds = len(ends) == 2 and all(2.0 <= x <= 6.0 for x in ends)
    return Claim("rests of UR10e", sentence, "2 to 6 s at both ends", holds)


def _lag(robot: str, low: float, high: float, bound: str) -> Claim:
    case, diagnosis = good(robot)
    agreed = unit_reading(case, case.logs[0]).agreement
    assert agreed is not None
    lag, error = 1e3 * agreed.lag, 1e3 * agreed.lag_std
    named = "lag" in finding(diagnosis, "velocity").says
    figure = f"{lag.min():.1f} to {lag.max():.1f} ms, standard error up to {error.max():.1f}"
    holds = named and bool(np.all((lag >= low) & (lag < high)))
    return Claim(f"velocity lag of {robot}", figure, bound, holds)


def _motors() -> list[Claim]:
    sentence = finding(good("tx40")[1], "position").says
    bare = examine(example_case("tx40", LOGS["tx40"], *MOTOR_KEYS), quick=True)
    found = finding(bare, "position")
    assert found.fix is not None
    return [
        Claim(
            "motor-side signals of TX40",
            sentence,
            "named with their ratios",
            "motor-side" in sentence and "32 32 45 -48 45 32" in sentence,
        ),
        Claim(
            "TX40 without its motor lines",
            f"{found.severity.word}: {found.says}",
            'wrong, coordinates = "motor"',
            found.severity == Severity.WRONG and 'coordinates = "motor"' in found.fix.says,
        ),
    ]


def _head() -> Claim:
    found = finding(examine(example_case("ur10e", BROKEN_HEAD), quick=True), "rows")
    count = re.match(r"(\d+) corrupt rows at the start", found.says)
    holds = count is not None and 7 <= int(count.group(1)) <= 19
    return Claim("corrupt head of ur-19_09_27-11_32_02", found.says, "7 to 19 rows named", holds)


def clean_logs() -> list[tuple[str, str]]:
    """Robot and log of every clean log in which something moves."""
    folder = data_folder()
    paths = sorted((folder / "ur10e").rglob("*.parquet"))
    still = re.compile(r"-p\d$|push_pose")
    moving = [str(p.relative_to(folder)) for p in paths if not still.search(p.stem)]
    others = [(robot, log) for robot, log in LOGS.items() if robot != "ur10e"]
    return [("ur10e", log) for log in moving] + others


def alarms() -> tuple[int, Counter[str], Counter[str]]:
    """Clean logs, and of how many of them each quick check is doubtful or worse.

    What is true of a log, because its authors say so, is counted by itself: that joints stand still
    in `jointwise_motion`, and that payloads are carried.
    """
    logs = clean_logs()
    false: Counter[str] = Counter()
    true: Counter[str] = Counter()
    for robot, log in logs:
        for found in examine(example_case(robot, log), quick=True).findings:
            known = re.search(TRUE.get(found.check, "$^"), log) is not None
            (true if known else false)[found.check] += found.severity != Severity.OK
    return len(logs), false, true


def _scan() -> list[Claim]:
    count, false, true = alarms()
    worst = max(false, key=lambda name: false[name])
    return [
        Claim(
            f"false alarms in {count} clean logs, {len(false)} quick checks",
            f"at most {100.0 * false[worst] / count:.1f} % ({worst}), {false.total()} in all",
            "<= 2 % per check",
            false[worst] <= 0.02 * count,
        ),
        Claim(
            "joints that stand still in jointwise motion: logs distinguished",
            str(true["excitation"]),
            "3",
            true["excitation"] == 3,
        ),
    ]


def _sideways() -> Claim:
    """The mounting of the AR5, against its URDF alone."""
    case = example_case("rokae_ar5", LOGS["rokae_ar5"], ("robot", "gravity"))
    diagnosis = examine(case, quick=True)
    wrong = [f.check for f in diagnosis.findings if f.severity == Severity.WRONG]
    gravity = {e.path: e.value for e in diagnosis.edits}.get(("robot", "gravity"))
    along = np.asarray(gravity or [0.0, 0.0, 0.0]) / 9.81
    tilt = float(np.rad2deg(np.arccos(np.clip(along[0], -1.0, 1.0))))
    return Claim(
        "AR5 without its mounting line, against the URDF",
        f"wrong: {', '.join(wrong) or 'nothing'}; gravity = {gravity}, {tilt:.1f}° from +x",
        f"mounting alone, gravity along +x within {NEAR:g}°",
        wrong == ["mounting"] and bool(gravity) and tilt < NEAR,
    )


def _reversed() -> Claim:
    """A short window of a Med 7, whose torques count the other way than its URDF's joints."""
    folder = data_folder() / "med7"
    file = log_files([f"{folder / 'med7_measurements.parquet'}@0:10.5"])
    case = case_of(subject_of(str(folder / "med7dock.urdf"), file[0]), file, None, silent)[0]
    found = finding(examine(case, quick=True), "effort sign")
    gains = [] if found.fix is None else [edit.value for edit in found.fix.edits]
    both = "all efforts have the opposite sign, or all positions have the opposite sign"
    return Claim(
        "10 s of a Med 7, against its URDF",
        f"{found.severity.word}: {found.says}",
        "efforts or positions reversed, gain = -1 for all joints",
        both in found.says and gains == [[-1.0] * 7],
    )


def main() -> list[Claim]:
    """Good robot files, true quirks, false alarms."""
    return [
        *(_passes(robot) for robot in LOGS),
        _clock(),
        _rests(),
        _lag("panda", 3.0, 7.0, "5 ± 2 ms"),
        _lag("tiago", 135.0, 195.0, "0.14 to 0.19 s, two digits"),
        *_motors(),
        _sideways(),
        _reversed(),
        _head(),
        *_scan(),
    ]


if __name__ == "__main__":
    main_of(main)

"""Fifteen inputs of people who do this job, as they would use them: what is said must be right.

They lie in the folder `cases` beside that of `STEELYARD_DATA`, each with what is right and how that
is known. Run by itself it takes names of cases: `python -m proofs.checks.cases z1-default`.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from proofs.support.claims import Claim, data_folder, main_of


class Case:
    """A copy of one case's folder, and the commands of its user there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.unseen: list[float] = []  # pooled errors of the last validation [% of used]

    def __call__(self, *arguments: str) -> str:
        """What a command prints, on one line with its exit code in front."""
        done = subprocess.run(
            [sys.executable, "-m", "steelyard", *arguments],
            cwd=self.folder,
            env={**os.environ, "COLUMNS": "200"},
            capture_output=True,
            text=True,
            check=False,
        )
        return f"exit {done.returncode}: {' '.join((done.stdout + done.stderr).split())}"

    def init(self, *arguments: str, to: str = "a.toml") -> str:
        """`init` without questions."""
        return self("init", *arguments, "--no-input", "-o", to)

    def identify(self, robot: str, *logs: str, validate: str) -> str:
        """`identify`, which leaves its unseen errors; empty of a refusal."""
        place = f"m{len(list(self.folder.glob('m*')))}"
        said = self("identify", robot, *logs, "--validate", validate, "-o", place)
        self.unseen, file = [], self.folder / place / "model.json"
        if file.is_file():
            told = self("validate", place, validate, "--json").partition(": ")[2]
            unseen: dict[str, Any]
            (unseen,) = json.loads(told)
            self.unseen = [float(one["percent_of_used"]) for one in unseen["headline"]["pooled"]]
        return said

    def within(self, *most: float) -> bool:
        """Whether there are unseen errors, each at most so large [%]."""
        return len(self.unseen) == len(most) and all(
            a <= b for a, b in zip(self.unseen, most, strict=True)
        )


def z1(case: Case) -> bool:
    """A chirp: no sign and no delay is wrong."""
    case.init("arm.urdf", "log.npz")
    said = case.identify("a.toml", "log.npz@0:17", validate="log.npz@17:23.5")
    return case.within(12.0) and "wrong sign" not in said and "failed check" not in said


def xm7(case: Case) -> bool:
    """A clock 20 times too slow."""
    case.init("arm.urdf", "log.csv")
    said = case("check", "a.toml", "log.csv")
    return "19.98 times d(q)/dt" in said and "the step is 4 ms" in said and "deg" not in said


def position_error(case: Case) -> bool:
    """Efforts that are position errors: unknown factors, and one scale for all."""
    case.init("arm.urdf", "run1.csv", "run2.csv")
    for logs in (["run1.csv"], ["run2.csv"], ["run1.csv", "run2.csv"]):
        said = case("check", "a.toml", *logs, "--fix", "f.toml")
        if "off by unknown factors" not in said or (case.folder / "f.toml").exists():
            return False
    gains = 'gain = ["identify", 1.0, "identify", "identify", "identify", "identify"]'
    text = (case.folder / "a.toml").read_text().replace('"joint_torque"', '"motor_current"')
    text = text.replace('unit = "Nm"', f'unit = "A"\n{gains}')
    (case.folder / "g.toml").write_text(text)
    said = case.identify("g.toml", "run1.csv", validate="run2.csv")
    return case.within(1.2) and "implausibly" not in said


def contact(case: Case) -> bool:
    """A push of three seconds in the fitted log."""
    case.init("arm.urdf", "run1.csv", "run2.csv")
    said = case.identify("a.toml", "run1.csv", validate="run2.csv")
    return case.within(1.2) and "a force acts" in said and "payload of" not in said


def tool(case: Case) -> bool:
    """A tool that was removed after the fit."""
    case.init("arm.urdf", "tool1.csv", "tool2.csv")
    case("identify", "a.toml", "tool1.csv", "tool2.csv", "-o", "m")
    said = case("validate", "m", "bare.csv")
    payload = case("payload", "m", "bare.csv", "--frame", "tool0")
    return "about 1.2 kg less on 'wrist3_link'" in said and "1.20" in payload and "less" in payload


def psm(case: Case) -> bool:
    """A sliding axis with mimic partners is no finger."""
    case.init("arm.urdf", "run1.csv", "run2.csv")
    case.identify("a.toml", "run1.csv", validate="run2.csv")
    text = (case.folder / "a.toml").read_text()
    return '"insertion"' in text and case.within(10.5, 14.0)


def gripper(case: Case) -> bool:
    """Seven columns, of which the last is a gripper's."""
    told = case.init("arm.urdf", "log.csv")
    case.identify("a.toml", "log.csv@0:4.8", validate="log.csv@4.8:7")
    return "locked gripper_joint" in told and case.within(5.5)


def polled(case: Case) -> bool:
    """The latest message read in a loop: no row is missing; what the user states counts."""
    case.init("arm.urdf", "log.csv")
    said = case("check", "a.toml", "log.csv")
    case.identify("a.toml", "log.csv@0:8", validate="log.csv@8:12")
    stated = case.init(
        "arm.urdf",
        "log.csv",
        "--ratios",
        "1,1,1",
        "--coupling",
        "joint3,joint2,1",
        to="b.toml",
    )
    return "No row is missing" in said and bool(case.unseen) and stated.startswith("exit 0")


def names(case: Case) -> bool:
    """Joints' names in text columns."""
    told = case.init("arm.urdf", "log.csv")
    case.identify("a.toml", "log.csv@0:7", validate="log.csv@7:10")
    return "by the joints' names in the log's rows" in told and case.within(1.5)


def sparse(case: Case) -> bool:
    """Rows of other topics."""
    case.init("arm.urdf", "log.csv")
    case.identify("a.toml", "log.csv@0:7", validate="log.csv@7:10")
    return case.within(1.2)


def copies(case: Case) -> bool:
    """A column that is there twice."""
    case.init("arm.urdf", "robot_data.csv")
    case.identify("a.toml", "robot_data.csv@0:5.5", validate="robot_data.csv@5.5:8")
    return case.within(1.5)


def clocks(case: Case) -> bool:
    """Wall clock as text, and seconds with nanoseconds."""
    for file in ("iso", "secs"):
        case.init("arm.urdf", f"{file}.csv", to=f"{file}.toml")
        case.identify(f"{file}.toml", f"{file}.csv@0:7", validate=f"{file}.csv@7:10")
        if not case.within(1.5):
            return False
    return True


def no_effort(case: Case) -> bool:
    """Messages without efforts."""
    return "no values of efforts" in case.init("arm.urdf", "bag")


def counts(case: Case) -> bool:
    """Counts of a servo: one unit for the family, and that it is not known."""
    told = case.init("arm.urdf", "run1.csv", "run2.csv")
    said = case.identify("a.toml", "run1.csv", validate="run2.csv")
    text = (case.folder / "a.toml").read_text()
    return (
        "the unit is not known" in told
        and re.search(r'^unit = "mA"', text, re.MULTILINE) is not None
        and case.within(1.2)
        and "common factor" in said
        and "implausibly" not in said
    )


def passive(case: Case) -> bool:
    """A joint without a motor."""
    told = case.init("furuta.urdf", "run1.csv", "run2.csv")
    said = case.identify("a.toml", "run1.csv", validate="run2.csv")
    return "no motor drives pendulum" in told and case.within(4.0) and "gain or scale" not in said


CASES: dict[str, Callable[[Case], bool]] = {
    "z1-default": z1,
    "xm7-clock": xm7,
    "position-error-effort": position_error,
    "contact-in-fit": contact,
    "tool-removed": tool,
    "psm-insertion": psm,
    "gripper-column": gripper,
    "mtm-polled": polled,
    "rostopic-names": names,
    "sparse-rows": sparse,
    "duplicate-columns": copies,
    "text-time": clocks,
    "bag-empty-effort": no_effort,
    "raw-counts": counts,
    "passive-joint": passive,
}


def main(chosen: tuple[str, ...] = tuple(CASES)) -> list[Claim]:
    """One claim a case."""
    claims = []
    for name in chosen:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / name
            shutil.copytree(data_folder().parent / "cases" / name, place)
            case = Case(place)
            right = CASES[name](case)
            errors = ", ".join(f"{one:.1f} %" for one in case.unseen)
            about = " ".join((CASES[name].__doc__ or "").split()).rstrip(".")
            claims.append(Claim(f"{name}: {about}", errors or "words", "as its README says", right))
            print(claims[-1].name, "right" if right else "WRONG", file=sys.stderr, flush=True)
    return claims


if __name__ == "__main__":
    main_of(lambda: main(tuple(sys.argv[1:]) or tuple(CASES)))

"""The app by clicks alone, on a UR10e: to the model of the commands, and faults put right.

A second workspace has the same logs with two exchanged columns and positions in degrees; a third
way, faults of all kinds in a simulated arm's log, shows whether every finding has a picture.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl
from proofs.checks.injected_faults import simulated
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.fault_kinds import KINDS
from proofs.support.faults import diagnosis

from steelyard.app.work_check import picture_of
from steelyard.robot.file.toml_schema import tomllib

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from app.guided import Visitor, serving, visiting  # noqa: E402

TIMED = True
MOST_SECONDS = 180.0  # from the first page to the report of the model
RUNS = {"run1": "ur-20_02_12-40sec_12harm", "run2": "ur-20_02_10-30sec_12harm"}
EXCHANGED = ("q2", "q3")


def main() -> list[Claim]:
    """Claims on times, files and pictures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [
            *_to_a_model(folder, data_folder() / "ur10e"),
            *_put_right(folder, data_folder() / "ur10e"),
            _pictures(folder / "faults"),
        ]


def _logs(folder: Path, data: Path) -> dict[str, pl.DataFrame]:
    folder.mkdir()
    (folder / "ur10e.urdf").write_bytes((data / "ur10e.urdf").read_bytes())
    logs = {n: pl.read_parquet(data / "identification" / f"{f}.parquet") for n, f in RUNS.items()}
    for run, log in logs.items():
        log.write_csv(folder / f"{run}.csv")
    return logs


def _drop(visitor: Visitor, given: Path) -> None:
    visitor.drop("robot", given / "ur10e.urdf")
    visitor.see(".space3d[data-drawn]")
    visitor.step("Logs")
    visitor.drop("logs", given / "run1.csv", given / "run2.csv")
    visitor.see(".picture .main-svg")
    visitor.idle()
    visitor.click("Next: check", "link")
    visitor.click("Check the logs")
    visitor.see(".verdict")
    visitor.idle()


def _to_a_model(folder: Path, data: Path) -> list[Claim]:
    given, workspace = folder / "given", folder / "workspace"
    _logs(given, data)
    with serving(workspace) as server, visiting(server.address) as visitor:
        start = time.monotonic()
        _drop(visitor, given)
        visitor.click("Next: identify", "link")
        visitor.click("Identify")
        visitor.see("iframe")
        visitor.idle()
        visitor.page.frame_locator("iframe").locator(".headline").first.wait_for()
        seconds = time.monotonic() - start
        wrong = visitor.wrong
    same = folder / "commands"
    for kind in ("robot", "logs"):
        (same / kind).mkdir(parents=True)
    (same / "robot" / "ur10e.urdf").write_bytes((given / "ur10e.urdf").read_bytes())
    for run in RUNS:
        (same / "logs" / f"{run}.csv").write_bytes((given / f"{run}.csv").read_bytes())
    logs = [f"logs/{run}.csv" for run in RUNS]
    _command(same, "init", "robot/ur10e.urdf", *logs, "-o", "robot.toml", "--no-input")
    fit = ["identify", "robot.toml", logs[0], "--validate", logs[1], "-o", "models/model-1"]
    _command(same, *fit)
    files = [
        "robot.toml",
        *(f"models/model-1/{x}" for x in ("model.json", "parameters.csv", "report.html")),
    ]
    other = [x for x in files if (same / x).read_bytes() != (workspace / x).read_bytes()]
    return [
        Claim("UR10e, from URDF and two CSV files to the model's report by clicks",
              f"{seconds:.0f} s", f"at most {MOST_SECONDS:.0f} s", seconds <= MOST_SECONDS),
        Claim("robot file, model, parameters and report as the commands write them",
              f"{len(files) - len(other)} of {len(files)} byte for byte", "all", not other),
        Claim("errors in the pages on the way", str(len(wrong)), "0", not wrong),
    ]  # fmt: skip


def _command(folder: Path, *words: str) -> None:
    command = [sys.executable, "-m", "steelyard", *words]
    subprocess.run(command, cwd=folder, capture_output=True, check=False, env=dict(os.environ))


def _put_right(folder: Path, data: Path) -> list[Claim]:
    """Columns of a log without units in their names, exchanged and in degrees."""
    given, workspace = folder / "bad", folder / "bad-workspace"
    a, b = EXCHANGED
    for run, log in _logs(given, data).items():
        plain = log.rename({f"q{k}_rad": f"q{k}" for k in range(1, 7)})
        q = {f"q{k}": plain[f"q{k}"].degrees() for k in range(1, 7)}
        q[a], q[b] = q[b], q[a]
        kept = [x for x in plain.columns if not x.startswith("dq")]
        plain.with_columns(**q).select(kept).write_csv(given / f"{run}.csv")
    with serving(workspace) as server, visiting(server.address) as visitor:
        _drop(visitor, given)
        visitor.page.wait_for_function("!document.querySelector('.picture:not([data-drawn])')")
        shown = visitor.page.locator(".finding[data-row]").count()
        drawn = visitor.page.locator(".finding .picture:has(.main-svg)").count()
        accept = visitor.page.get_by_role("button", name="Accept")
        clicks = 0
        while accept.count() and clicks < 5:
            accept.first.click()
            visitor.idle()
            clicks += 1
        visitor.see("text=Put right by the last fix")
        pairs = visitor.page.locator("[aria-labelledby=right] .picture").count()
        text = (workspace / "robot.toml").read_text()
        opened = visitor.page.get_by_role("link", name="Next: identify").count()
    signals = tomllib.loads(text)["signals"]
    right = [f"q{k}" for k in (1, 3, 2, 4, 5, 6)]
    holds = signals["position"] == right and signals["position_unit"] == "deg" and bool(opened)
    return [
        Claim("exchanged columns and degrees put right by clicks, the next step opens",
              f"{signals['position']} in {signals['position_unit']}, {clicks} clicks",
              f"{right} in deg", holds),
        Claim("findings on the way that are drawn", f"{drawn} of {shown}", "all",
              0 < shown <= drawn),
        Claim("pictures before and after the fix", str(pairs), "2 or more", pairs >= 2),
    ]  # fmt: skip


def _pictures(folder: Path) -> Claim:
    """Every kind of fault, drawn once, in a simulated log."""
    clean, bare, checks = simulated(folder)[0], set[str](), set[str]()
    for number, kind in enumerate(KINDS.values()):
        faulty = kind(clean, np.random.default_rng(number))
        if faulty is None:
            continue
        for finding in diagnosis(clean, faulty.text, faulty.table).findings:
            if finding.severity:
                checks.add(finding.check)
                bare |= {finding.check} if picture_of(finding) is None else set()
    drawn = f"{len(checks - bare)} of {len(checks)}"
    named = f"; without: {', '.join(sorted(bare))}" if bare else ""
    what = f"checks that {len(KINDS)} kinds of fault alarm, whose findings all have pictures"
    return Claim(what, drawn + named, "all", bool(checks) and not bare)


if __name__ == "__main__":
    main_of(main)

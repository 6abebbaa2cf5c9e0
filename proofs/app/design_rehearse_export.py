"""A motion for a Panda in a cell by clicks alone: designed, rehearsed, exported.

The cell is the box of the tool of `proofs/problems/panda.toml`, with a floor and a box to keep out
of. What a page writes is compared with what the commands write from the same robot file; a search
is stopped, and keeps its best motion. The model of the rehearsal is then put into the workspace as
`steelyard identify -o models/...` would, and exported.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from zipfile import ZipFile

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of

import steelyard
from steelyard.robot.file.toml_schema import tomllib

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from app.guided import Visitor, serving, visiting  # noqa: E402

TIMED = True
FOLDER = "robot/panda_description/urdf/panda.urdf"
BOX = {"x": [-0.75, 0.75], "y": [-0.75, 0.75], "z": [0.1, 1.2]}
FLOOR, KEEP_OUT = -0.01, {"x": [0.3, 0.6], "y": [-0.7, -0.4], "z": [0.0, 0.4]}
SAMPLES = 20_001  # times at which the tool is looked for outside of its room
MOST_STOP_SECONDS = 60.0  # from the stop of a search to the motion that is shown
LEAST_INSIDE = 0.85  # of the planted values, in their 95 % intervals
MOST_ERROR = 2.0  # of the torque on another motion [%]


def main() -> list[Claim]:
    """Claims on the motion, the rehearsal, files, and on errors in the pages."""
    with tempfile.TemporaryDirectory() as name:
        workspace = Path(name) / "workspace"
        with serving(workspace) as server, visiting(server.address) as visitor:
            _give_robot(visitor)
            claims = [
                *_room(visitor, workspace),
                *_designed(visitor, workspace),
                *_rehearsed(visitor, workspace),
                *_exported(visitor, workspace),
                _stopped(visitor, workspace),
            ]
            wrong = [one for one in visitor.wrong if "422" not in one]
        claims.append(Claim("errors in the pages on the way", str(len(wrong)), "0", not wrong))
        return claims


def _give_robot(visitor: Visitor) -> None:
    """Drop the folder of the Panda; files that are no model are refused, and said to be."""
    model = data_folder().parent / "models" / "panda_description"
    visitor.page.set_input_files("#folder-robot", str(model))
    visitor.idle()
    visitor.page.select_option("select[name=model]", FOLDER)
    visitor.click("This is the robot")
    visitor.see(".space3d[data-drawn]")
    visitor.idle()
    visitor.step("Design")
    visitor.see(".space3d[data-drawn]")
    visitor.idle()


def _room(visitor: Visitor, workspace: Path) -> list[Claim]:
    page = visitor.page
    before = (workspace / "robot.toml").read_text()
    page.select_option("select[name=frame]", "panda_hand_tcp")
    for axis, ends in BOX.items():
        for end, value in zip(("from", "to"), ends, strict=True):
            page.fill(f"[name=box-{axis}-{end}]", str(value))
    page.fill("[name=floor]", str(FLOOR))
    page.fill("[name=keep_out]", " ".join(str(x) for span in KEEP_OUT.values() for x in span))
    visitor.click("Write into the robot file")
    visitor.idle()
    written = (workspace / "robot.toml").read_text()
    found = tomllib.loads(written)["excitation"]["workspace"]
    wanted = {"frame": "panda_hand_tcp", "floor": FLOOR, "box": BOX, "keep_out": [KEEP_OUT]}
    visitor.click("Undo the last change of the robot file")
    visitor.idle()
    undone = (workspace / "robot.toml").read_text() == before
    (workspace / "robot.toml").write_text(written)
    page.reload()
    visitor.see(".space3d[data-drawn]")
    visitor.idle()
    return [
        Claim("walls by clicks, in the robot file", str(found), "as filled in", found == wanted),
        Claim("undo takes them back", "yes" if undone else "no", "yes", undone),
    ]


def _designed(visitor: Visitor, workspace: Path) -> list[Claim]:
    page = visitor.page
    page.fill("[name=budget]", "20")
    page.select_option("#format", "ros2")
    visitor.click("Design the motion")
    visitor.see("[data-play]")
    visitor.idle()
    folder = workspace / "motions" / "motion-1"
    certificate = json.loads((folder / "certificate.json").read_text())
    motion = steelyard.read_trajectory(folder / "trajectory.json", workspace / "robot.toml")
    far = _outside(motion, workspace)
    curves = page.locator("[data-over-time] .legend li").count()
    page.locator("[data-time]").evaluate(
        "e => { e.value = 5; e.dispatchEvent(new Event('input')) }"
    )
    clock = page.inner_text("[data-now]")
    mark = page.locator("[data-over-time] .cursor").count()
    exported = _command(workspace, "excite", "replay.toml", "-o", "same", "--format", "ros2")
    same = [
        name
        for name in ("trajectory.json", "trajectory.csv", "trajectory.yaml")
        if (folder / name).exists()
    ]
    return [
        Claim("a motion of the Panda in its cell, proven at all times",
              page.inner_text("[aria-labelledby=design] .headline"), "the certificate holds",
              certificate["holds"]),
        Claim(f"the tool beyond its box at {SAMPLES} times, by the model's own kinematics",
              f"{1e3 * far:.3g} mm", "0 mm", far <= 0.0),
        Claim("clock and clearances of the replay", f"{clock}, {curves} clearances, {mark} mark",
              "5.0 s, clearances with a mark", clock == "5.0 s" and curves >= 3 and mark == 1),
        Claim("files for the controller", ", ".join(same), "three of three", len(same) == 3),
        exported,
    ]  # fmt: skip


def _outside(motion: steelyard.Trajectory, workspace: Path) -> float:
    """How far the tool's point leaves its box, at most [m]."""
    model = steelyard.model_of(workspace / "robot.toml").prior
    q = motion.sample(np.linspace(0.0, motion.duration, SAMPLES)).q
    place = np.array(model.pose(q, "panda_hand_tcp")[0])
    low, high = np.array([*BOX.values()]).T
    return float(np.maximum(low - place, place - high).max())


def _command(workspace: Path, *words: str) -> Claim:
    """The command verifies the page's motion against the same robot file, by a replay."""
    text = (workspace / "robot.toml").read_text()
    motion = '[excitation.motion]\nkind = "replay"\nfile = "motions/motion-1/trajectory.json"\n'
    (workspace / "replay.toml").write_text(f"{text}\n{motion}")
    done = subprocess.run(
        [sys.executable, "-m", "steelyard", *words],
        cwd=workspace, capture_output=True, text=True, check=False, env=dict(os.environ),
    )  # fmt: skip
    names = ("trajectory.csv", "trajectory.yaml")
    there = workspace / "same"
    equal = [
        x
        for x in names
        if (there / x).exists()
        and (there / x).read_bytes() == (workspace / "motions/motion-1" / x).read_bytes()
    ]
    (workspace / "replay.toml").unlink()
    return Claim(
        "`steelyard excite` of this motion: exit code, files equal byte for byte",
        f"{done.returncode}, {len(equal)} of {len(names)}", "0 or 3 (proven), all",
        done.returncode in (0, 3) and len(equal) == len(names),
    )  # fmt: skip


def _rehearsed(visitor: Visitor, workspace: Path) -> list[Claim]:
    visitor.page.fill("[name=seed]", "7")
    visitor.click("Rehearse")
    visitor.see("text=Planted and identified values")
    visitor.idle()
    rows = visitor.page.locator("#planted tbody tr").count()
    inside = visitor.page.locator("#planted tbody tr td:last-child").all_text_contents()
    share = float(np.mean([one.strip() == "yes" for one in inside]))
    line = visitor.page.inner_text("[aria-labelledby=rehearsal] .headline")
    model = workspace / "reports" / "rehearsal-1" / "model"
    scores = steelyard.validate(model, workspace / "reports" / "rehearsal-1" / "other.csv").scores
    table = scores.table
    percent = 100.0 * float(np.sqrt((table["error"] ** 2).mean() / (table["used"] ** 2).mean()))
    return [
        Claim("planted parameters in the 95 % intervals of those identified",
              f"{100.0 * share:.0f} % of {rows}", f"at least {100.0 * LEAST_INSIDE:.0f} %",
              share >= LEAST_INSIDE),
        Claim(f"error on another motion of the virtual robot ({line})", f"{percent:.2g} %",
              f"at most {MOST_ERROR:g} %", percent <= MOST_ERROR),
    ]  # fmt: skip


def _exported(visitor: Visitor, workspace: Path) -> list[Claim]:
    """The file for the controller, and the rehearsed model as C and URDF, all downloaded."""
    page = visitor.page
    with page.expect_download() as got:
        page.click("a[href='/download/motions/motion-1/trajectory.yaml']")
    yaml = got.value.path().read_bytes()
    same = yaml == (workspace / "motions/motion-1/trajectory.yaml").read_bytes()
    target = workspace / "models" / "rehearsed"
    target.mkdir()
    for name in ("model.json", "report.html"):
        (target / name).write_bytes((workspace / "reports/rehearsal-1/model" / name).read_bytes())
    visitor.step("Use")
    got_all = []
    for form, address in (("c", "rehearsed-c"), ("urdf", "rehearsed.urdf")):
        page.select_option("#to", form)
        visitor.click("Export")
        link = page.locator(f"a[href='/download/exports/{address}']")
        link.first.wait_for()
        visitor.idle()
        with page.expect_download() as got:
            link.first.click()
        got_all.append(got.value)
    with ZipFile(got_all[0].path()) as packed:
        names = packed.namelist()
    mass = steelyard.load_robot(workspace / "exports" / "rehearsed.urdf").robot.bodies
    holds = any(name.endswith(".c") for name in names) and len(mass) >= 7
    return [
        Claim("the file for ROS 2, downloaded", f"{len(yaml)} bytes", "as in the folder", same),
        Claim("the rehearsed model downloaded as C and as URDF",
              f"{len(names)} files of C; {len(mass)} bodies", "C sources; 7 bodies or more",
              holds),
    ]  # fmt: skip


def _stopped(visitor: Visitor, workspace: Path) -> Claim:
    visitor.step("Design")
    visitor.idle()
    visitor.page.fill("[name=budget]", "600")
    visitor.click("Design another motion")
    visitor.see("#jobs:has-text('best ')")
    start = time.monotonic()
    visitor.click("Stop")
    visitor.see("text=Stopped early")
    visitor.idle()
    seconds = time.monotonic() - start
    certificate = json.loads((workspace / "motions/motion-2/certificate.json").read_text())
    return Claim(
        "a search of 600 s that is stopped keeps its best motion, proven",
        f"after {seconds:.0f} s", f"at most {MOST_STOP_SECONDS:.0f} s, the certificate holds",
        seconds <= MOST_STOP_SECONDS and certificate["holds"],
    )  # fmt: skip


if __name__ == "__main__":
    main_of(main)

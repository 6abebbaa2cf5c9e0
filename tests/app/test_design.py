"""The step of designed motions: its room in the robot file, a design that is stopped, rehearsal."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.guided import Finished
from steelyard.app.downloads import download
from steelyard.app.step_design import FORMATS
from steelyard.app.steps import STEPS, current, named
from steelyard.app.work_design import design, rehearse
from steelyard.base.errors import DataError, ModelError, OutputError, SteelyardError
from steelyard.base.progress import Event, silent
from steelyard.excite.controller_file_formats import EXPORTS
from steelyard.robot.file.toml_schema import tomllib

WALLS = {
    "floor": "0.05",
    "box-z-from": "0.1",
    "box-z-to": "1.2",
    "planes": "0 -1 0 -0.5",
    "keep_out": "0.3 0.5 -0.8 -0.6 0 0.3",
    "period": "6",
}


@pytest.fixture
def robot(desk: Finished, arm: Path) -> Finished:
    """A desk on a workspace with a robot and no log."""
    (desk.workspace.folder / "robot" / "arm.urdf").write_bytes((arm / "arm.urdf").read_bytes())
    desk.act("robot", "added")
    return desk


def form(desk: Finished, **changes: str) -> dict[str, str]:
    """The fields of the room, as its page sends them."""
    now = named("design").numbers(desk)["now"]
    rows = {x: "\n".join(" ".join(map(str, row)) for row in now[x]) for x in ("planes", "keep_out")}
    return {**{name: str(value) for name, value in now.items()}, **rows, **changes}


def excitation(desk: Finished) -> dict[str, Any]:
    found: dict[str, Any] = tomllib.loads(desk.workspace.robot_text or "")["excitation"]
    return found


def test_every_format_has_words() -> None:
    assert FORMATS.keys() == EXPORTS.keys()


def test_the_step_is_open_without_a_log_and_on_nobodys_way(robot: Finished) -> None:
    assert named("design").locked(robot) == ""
    assert current(robot).name == "logs"
    assert [step.name for step in STEPS].index("design") == 3


def test_the_room_is_lines_of_the_robot_file_and_undone(robot: Finished) -> None:
    before = robot.workspace.robot_text
    robot.act("design", "room", **form(robot))
    assert robot.workspace.robot_text == before, "nothing is written where nothing differs"
    robot.act("design", "room", **form(robot, **WALLS))
    assert excitation(robot) == {
        "limits": {"share": 0.95},
        "workspace": {
            "floor": 0.05,
            "box": {"z": [0.1, 1.2]},
            "planes": [{"normal": [0.0, -1.0, 0.0], "above": -0.5}],
            "keep_out": [{"x": [0.3, 0.5], "y": [-0.8, -0.6], "z": [0.0, 0.3]}],
        },
        "motion": {"period": 6.0},
    }
    written = robot.workspace.robot_text
    robot.act("design", "room", **form(robot))
    assert robot.workspace.robot_text == written
    robot.act("design", "room", **form(robot, floor="", planes="", **{"box-z-to": "1.0"}))
    assert excitation(robot)["workspace"].keys() == {"box", "keep_out"}
    robot.workspace.undo()
    robot.workspace.undo()
    assert robot.workspace.robot_text == before


def test_walls_and_the_tool_are_drawn(robot: Finished) -> None:
    plain = named("design").numbers(robot)["room"].result
    robot.act("design", "room", **form(robot, **WALLS))
    drawn = named("design").numbers(robot)["room"].result
    assert plain["lines"] == []
    assert {lines["colour"] for lines in drawn["lines"]} == {"--blue", "--poor"}
    assert len(drawn["solids"]) == len(plain["solids"]) + 1, "the box to keep out of"
    (box,) = (one for one in drawn["solids"] if one.get("colour") == "--poor")
    assert box["body"] == -1 and box["position"] == pytest.approx([0.4, -0.7, 0.15])
    heights = {round(end[2], 9) for one in drawn["lines"] for pair in one["points"] for end in pair}
    assert {0.05, 0.1, 1.2, 0.3} <= heights


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("floor", "high"),
        ("floor", "nan"),
        ("box-x-from", "1"),
        ("box-z-to", "-3"),
        ("planes", "1 2 3"),
        ("planes", "0 0 1 0\n" * 51),
        ("keep_out", "0 1 0 1 1 0"),
        ("share", "2"),
        ("share", ""),
        ("period", "-1"),
        ("harmonics", "2.5"),
        ("radius", "-0.1"),
        ("world", "../cell.urdf"),
    ],
)
def test_what_is_no_room_is_refused_and_not_written(
    robot: Finished, field: str, value: str
) -> None:
    given = form(robot, **{"box-z-from": "0.1", "box-z-to": "1.2"})
    before = robot.workspace.robot_text
    if (field, value) == ("share", ""):
        robot.act("design", "room", **{**given, field: value})
        assert "share" not in excitation(robot).get("limits", {}), "the usual share"
        return
    with pytest.raises((DataError, ModelError)):
        robot.act("design", "room", **{**given, field: value})
    assert robot.workspace.robot_text == before


def test_forms_of_a_design_that_cannot_begin(robot: Finished) -> None:
    for action, given in (
        ("design", {}),
        ("design", {"budget": "0.1", "format": "csv"}),
        ("design", {"budget": "x", "format": "csv"}),
        ("design", {"budget": "5", "format": "gcode"}),
        ("design", {"budget": "5", "format": "csv"}),
        ("design", {**form(robot, floor="high"), "budget": "5", "format": "csv"}),
        ("show", {"motion": "../motion"}),
        ("rehearse", {"seed": "1"}),
        ("room", {}),
    ):
        with pytest.raises(SteelyardError):
            robot.act("design", action, **given)
    assert not list(robot.workspace.folder.glob("motions/*"))


def test_a_motion_that_a_controller_cannot_run_is_refused_before_the_search(
    robot: Finished,
) -> None:
    assert "nothing limits where the robot may move" in robot.page("design")
    robot.act("design", "design", **form(robot, floor="0.3"), budget="3600", format="urscript")
    assert excitation(robot)["workspace"] == {"floor": 0.3}, "what was typed is designed for"
    begun = robot.jobs.begun[-1]
    assert begun.given["budget"] == 3600.0 and robot.known(begun.key(robot.workspace)) is None
    fit = named("design").numbers(robot)["fit"]
    assert "six revolute joints" in fit.error["wrong"]
    page = robot.page("design")
    assert "six revolute joints" in page and 'value="3600.0"' in page
    assert "nothing limits where the robot may move" not in page


@pytest.mark.slow
def test_a_stop_keeps_the_best_motion(robot: Finished) -> None:
    def stop(event: Event) -> bool:
        return not event.note  # it names the best so far

    found = design("robot.toml", "motions/motion-1", 60.0, ["csv"], stop)
    assert found["stopped"] and found["failures"] == []
    assert json.loads(Path("motions/motion-1/certificate.json").read_text())["holds"]


@pytest.mark.slow
def test_a_motion_is_designed_shown_and_rehearsed(robot: Finished) -> None:
    robot.act("design", "room", **form(robot, **WALLS))
    robot.act("design", "design", **form(robot), budget="4", format="ros2")
    page, numbers = robot.page("design"), named("design").numbers(robot)
    folder = Path("motions/motion-1")
    names = {"trajectory.json", "trajectory.csv", "trajectory.yaml", "certificate.json"}
    assert {path.name for path in folder.iterdir()} == names | {"report.html"}
    assert 'href="/download/motions/motion-1/trajectory.yaml"' in page
    assert download(robot.workspace, "motions/motion-1/trajectory.csv")[1] is None
    view = numbers["view"].result
    assert view["beyond"] == [] and view["figure"] is not None
    proven = {row["name"]: row["least"] for row in view["proven"]}
    assert proven["floor, planes and boxes"] >= 0.0 and proven["tool box"] >= 0.0
    robot.act("design", "room", **form(robot, planes="0 -1 0 0.5"))
    violated = named("design").numbers(robot)["view"].result["beyond"]
    assert any("plane 1" in one for one in violated), "the arm is on the other side"
    assert not any("e+" in one for one in violated)
    robot.workspace.undo()
    rehearsed = rehearse("robot.toml", str(folder), "reports/rehearsal-1", 1, silent)
    assert rehearsed["level"] == "good"
    inside = [row[-1] == "yes" for row in rehearsed["rows"]]
    assert len(inside) == 25 and np.mean(inside) >= 0.8
    assert Path("reports/rehearsal-1/model/report.html").exists()
    assert {p.name for p in Path("reports/rehearsal-1").glob("*.csv")} == {
        "designed.csv",
        "other.csv",
    }


def test_names_of_strangers_are_escaped(desk: Finished, arm: Path) -> None:
    evil = "<script>document.body.dataset.errors='ran'</script>"
    escaped = evil.replace("<", "&lt;").replace(">", "&gt;").replace("'", "&apos;")
    urdf = (arm / "arm.urdf").read_text()
    for name in ('"joint1"', '"link3"'):
        urdf = urdf.replace(name, f'"{name[1:-1]}{escaped}"')
    (desk.workspace.folder / "robot" / "arm.urdf").write_text(urdf)
    desk.act("robot", "added")
    desk.act("design", "room", **form(desk, frame=f"link3{evil}"))
    page = desk.page("design")
    assert evil not in page and page.count("&lt;script&gt;") >= 2
    assert named("design").numbers(desk)["room"].result["tool"] == f"link3{evil}"


def test_downloads_stay_in_the_workspace(robot: Finished) -> None:
    folder = robot.workspace.folder
    (folder.parent / "secret.txt").write_text("secret")
    code = folder / "exports" / "model-c"
    (code / "inner").mkdir(parents=True)
    (code / "model.c").write_text("int x;\n")
    (code / "inner" / "a.h").write_text("")
    (code / "stolen.txt").symlink_to(folder.parent / "secret.txt")
    (code / "away").symlink_to(folder.parent)
    path, content = download(robot.workspace, "exports/model-c")
    assert path == code and content is not None
    from io import BytesIO
    from zipfile import ZipFile

    names = set(ZipFile(BytesIO(content)).namelist())
    assert names == {"model-c/model.c", "model-c/inner/a.h"}
    for name in ("exports", "exports/", "robot/arm.urdf", "robot.toml", "exports/../robot.toml",
                 "exports/model-c/stolen.txt", "exports/none", "", "/etc/passwd"):  # fmt: skip
        with pytest.raises(OutputError):
            download(robot.workspace, name)

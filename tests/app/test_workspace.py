"""A folder as a workspace: no path leads out of it, every change of the robot file is undone."""

from pathlib import Path

import pytest

from steelyard.app.workspace import ROBOT_FILE, Workspace, opened
from steelyard.base.errors import DataError, OutputError
from steelyard.robot.file.toml_edits import Edit

OUTSIDE = [
    "../secret",
    "logs/../../secret",
    "/etc/passwd",
    "..",
    "",
    "logs/./../..",
    "a\0b",
    "..\\x",
]


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return opened(tmp_path / "workspace")


@pytest.mark.parametrize("name", OUTSIDE)
def test_no_name_leads_out(workspace: Workspace, name: str) -> None:
    (workspace.folder.parent / "secret").write_text("x")
    with pytest.raises(OutputError, match="leads out of the workspace"):
        workspace.path(name)


def test_links_that_lead_out_are_refused_and_not_listed(
    workspace: Workspace, tmp_path: Path
) -> None:
    secret = tmp_path / "secret.csv"
    secret.write_text("t,q\n")
    (workspace.folder / "logs" / "linked.csv").symlink_to(secret)
    (workspace.folder / "logs" / "own.csv").write_text("t,q\n")
    with pytest.raises(OutputError, match="leads out"):
        workspace.path("logs/linked.csv")
    assert workspace.logs == ("logs/own.csv",)


def test_files_with_names_that_are_refused_do_not_keep_changes_from_being_seen(
    workspace: Workspace, tmp_path: Path
) -> None:
    (workspace.folder / "logs" / "linked.csv").symlink_to(tmp_path / "outside.csv")
    before = workspace.fingerprint()
    (workspace.folder / "logs" / "a\\b.csv").write_text("t,q\n")
    assert workspace.fingerprint() != before


@pytest.mark.parametrize(
    ("given", "stored"),
    [
        ("run 1.csv", "logs/run_1.csv"),
        ("a/b/run.csv", "logs/a/b/run.csv"),
        ("<script>.csv", "logs/_script_.csv"),
        ("run@5:20.csv", "logs/run_5_20.csv"),
        (".hidden.csv", "logs/hidden.csv"),
        ("C:\\logs\\run.CSV", "logs/C_/logs/run.CSV"),
    ],
)
def test_names_of_strangers_are_made_plain(workspace: Workspace, given: str, stored: str) -> None:
    assert workspace.new_file("logs", given) == workspace.folder / stored


@pytest.mark.parametrize(
    "given", ["run.exe", "../run.csv", "a/../../run.csv", "", "...", "x/" * 9 + "y.csv"]
)
def test_what_is_no_log_is_refused(workspace: Workspace, given: str) -> None:
    with pytest.raises(DataError):
        workspace.new_file("logs", given)


def test_every_change_is_undone_that_of_an_editor_too(workspace: Workspace) -> None:
    texts = ['[robot]\nurdf = "a"\n', '[robot]\nurdf = "b"\n', '[robot]\nurdf = "by hand"\n']
    workspace.write_robot(texts[0])
    workspace.edit_robot([Edit(("robot", "urdf"), "b")])
    (workspace.folder / ROBOT_FILE).write_text(texts[2])
    assert workspace.last_change == ('-urdf = "b"', '+urdf = "by hand"')
    workspace.edit_robot([Edit(("robot", "name"), "arm")])
    assert workspace.last_change == ('+name = "arm"',)
    for text in texts[::-1]:
        workspace.undo()
        assert workspace.robot_text == text
    workspace.undo()
    assert workspace.robot_text is None
    with pytest.raises(OutputError, match="nothing was changed"):
        workspace.undo()


def test_undo_of_a_change_by_hand_alone(workspace: Workspace) -> None:
    workspace.write_robot("a = 1\n")
    (workspace.folder / ROBOT_FILE).write_text("a = 2\n")
    workspace.undo()
    assert workspace.robot_text == "a = 1\n"


def test_another_robot_file_counts_where_it_is_the_only_one(workspace: Workspace) -> None:
    (workspace.folder / "pyproject.toml").write_text("[project]\n")
    assert workspace.robot_text is None
    (workspace.folder / "ur10e.toml").write_text("[robot]\n")
    assert workspace.robot_text == "[robot]\n"
    workspace.write_robot("[robot]\na = 2\n")
    assert (workspace.folder / "ur10e.toml").read_text() == "[robot]\na = 2\n"
    assert (workspace.folder / "pyproject.toml").read_text() == "[project]\n"
    (workspace.folder / "other.toml").write_text("[robot.dh]\n")
    assert workspace.robot_text is None


def test_undo_never_takes_the_users_own_file_away(workspace: Workspace) -> None:
    own = workspace.folder / "robot.toml"
    own.write_text("# mine\n")
    workspace.write_robot("# changed\n")
    workspace.undo()
    assert own.read_text() == "# mine\n" and workspace.last_change == ()
    with pytest.raises(OutputError, match="nothing was changed"):
        workspace.undo()
    assert own.read_text() == "# mine\n"


def test_a_robot_file_that_is_no_text_is_replaced_by_its_last_version(workspace: Workspace) -> None:
    workspace.write_robot("[robot]\n")
    (workspace.folder / "robot.toml").write_bytes(b"name = \xff\n")
    assert not workspace.readable
    workspace.undo()
    assert workspace.robot_text == "[robot]\n" and workspace.readable


def test_a_file_is_put_aside_of_a_link_the_link(workspace: Workspace) -> None:
    target = workspace.folder / "robot.toml"
    target.write_text("[robot]\n")
    (workspace.folder / "logs" / "rt.csv").symlink_to("../robot.toml")
    for text in ("1", "2"):
        (workspace.folder / "logs" / "a.csv").write_text(text)
        workspace.remove("logs/a.csv")
    workspace.remove("logs/rt.csv")
    assert workspace.logs == () and target.is_file()
    kept = sorted(path.name for path in (workspace.folder / "removed").iterdir())
    assert kept == ["1-a.csv", "1-rt.csv", "2-a.csv"]


def test_choices_are_kept_and_a_damaged_file_counts_as_none(workspace: Workspace) -> None:
    workspace.choose(validate="logs/a.csv", model="robot/a.urdf")
    workspace.choose(model=None)
    assert workspace.choices == {"validate": "logs/a.csv"}
    own = workspace.folder / "app.json"
    for text in (own.read_text().replace("a.csv", "b.csv"), '{"choices": 3}', '{"roles": [1]}'):
        own.write_text(text)  # by hand
        assert workspace.choices == {}
    workspace.choose(validate="logs/a.csv")
    (workspace.folder / "app.json").write_text("[[[")
    assert workspace.choices == {}


def test_the_fingerprint_sees_what_commands_write(workspace: Workspace) -> None:
    seen = {workspace.fingerprint()}
    for name in ("robot.toml", "logs/a.csv", "models/m/model.json", "reports/check.html"):
        path = workspace.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
        seen.add(workspace.fingerprint())
    assert len(seen) == 5 and workspace.fingerprint() in seen


def test_a_package_of_ros_is_no_model(workspace: Workspace) -> None:
    for name in ("package.xml", "arm.urdf"):
        (workspace.folder / "robot" / name).write_text("<a/>")
    assert workspace.robot_models == ("robot/arm.urdf",)
    assert workspace.model_files == ("robot/arm.urdf", "robot/package.xml")

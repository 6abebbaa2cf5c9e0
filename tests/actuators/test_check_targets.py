"""What a check says of logs of targets before actuators are identified."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from proofs.support.servo_arm import ROBOT_FILE, URDF, Servos, made
from typer.testing import CliRunner

import steelyard
from steelyard.base.errors import LogError
from steelyard.check.finding import Finding, Severity
from steelyard.cli.app import app


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("servos")
    made(place, Servos())
    return place


def found(robot: Path, log: Path | str) -> dict[str, Finding]:
    result = steelyard.check_targets(robot, log)
    return {one.check: one for one in result.last.findings}


def changed(folder: Path, place: Path, table: pl.DataFrame, more: str = "") -> dict[str, Finding]:
    """Findings for another log of the same arm, with more lines in the robot file."""
    table.write_csv(place / "log.csv")
    (place / "servos.urdf").write_text((folder / "servos.urdf").read_text())
    (place / "servos.toml").write_text(ROBOT_FILE + more)
    return found(place / "servos.toml", place / "log.csv")


def test_a_good_log_shows_zeros_and_gives_all_joints_a_scale(folder: Path) -> None:
    findings = found(folder / "servos.toml", folder / "servo_fit.csv")
    assert list(findings) == ["targets", "motion", "signs", "joint zeros", "limits", "scale"]
    assert not any(one.severity for one in findings.values())
    scale = findings["scale"]
    assert scale.answered and scale.says == "the masses of the model file (shoulder, elbow)"
    zeros = [float(x) for x in findings["joint zeros"].says.split() if x.lstrip("-")[0].isdigit()]
    assert zeros == pytest.approx([0.0, 0.0], abs=0.05)


def test_a_reversed_joint_is_named(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv").with_columns(-pl.col("q2"), -pl.col("target2"))
    findings = changed(folder, tmp_path, table, "position_offset = [0.0, 0.0]\n")
    assert findings["signs"].says == "positions of elbow count against the model file's"
    open_ = changed(folder, tmp_path, table)["signs"]  # another zero does as well
    assert not open_.answered and "not decided for" in open_.says
    stated = changed(folder, tmp_path, table, "position_sign = [1, -1]\n")
    assert stated["signs"].says == "as stated: with others motion does not fit better"


def test_stated_signs_and_zeros_that_motion_contradicts_are_doubtful(
    folder: Path, tmp_path: Path
) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    both = "position_sign = [1, {}]\nposition_offset = [0.0, {}]\n"
    right = changed(folder, tmp_path, table, both.format(1, 0.0))
    assert not any(right[name].severity for name in ("signs", "joint zeros"))
    assert right["signs"].answered and right["joint zeros"].answered
    turned = changed(folder, tmp_path, table, both.format(-1, 0.0))["signs"]
    assert turned.severity is Severity.DOUBTFUL and turned.joints == ("elbow",)
    assert "the other sign of elbow" in turned.says
    moved = changed(folder, tmp_path, table, both.format(1, 0.5))["joint zeros"]
    assert moved.severity is Severity.DOUBTFUL and moved.joints == ("elbow",)
    place = float(moved.says.split("elbow at ")[1].split()[0])
    assert place == pytest.approx(0.0, abs=0.05)


def test_a_stated_zero_that_is_a_little_off_is_doubtful_too(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    more = "position_sign = [1, 1]\nposition_offset = [0.0, 0.09]\n"
    found = changed(folder, tmp_path, table, more)["joint zeros"]
    assert found.severity is Severity.DOUBTFUL and found.joints == ("elbow",)


def test_zeros_that_are_not_stated_are_those_of_the_stated_signs(
    folder: Path, tmp_path: Path
) -> None:
    table = pl.read_csv(folder / "servo_fit.csv").with_columns(-pl.col("q2"), -pl.col("target2"))
    zeros = changed(folder, tmp_path, table, "position_sign = [1, -1]\n")["joint zeros"]
    found = [float(x) for x in zeros.says.split() if x.lstrip("-")[0].isdigit()]
    assert found == pytest.approx([0.0, 0.0], abs=0.05)


def test_motion_a_little_beyond_the_limits_is_told(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    (tmp_path / "servos.urdf").write_text(
        URDF.replace('lower="-1.8" upper="1.8"', 'lower="-1.1" upper="1.1"')
    )
    (tmp_path / "servos.toml").write_text(ROBOT_FILE)
    table.write_csv(tmp_path / "log.csv")
    limits = found(tmp_path / "servos.toml", tmp_path / "log.csv")["limits"]
    assert not limits.severity and "shoulder is at -1.2" in limits.says


def test_exchanged_targets_are_wrong_and_nothing_else_is_asked(
    folder: Path, tmp_path: Path
) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    table = table.rename({"target1": "target2", "target2": "target1"})
    findings = changed(folder, tmp_path, table)
    assert list(findings) == ["targets"]
    assert findings["targets"].severity is Severity.WRONG
    assert "follow the targets 'target2'" in findings["targets"].says


def test_a_joint_that_rests_and_a_short_log_are_named(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    still = table.with_columns(q2=pl.lit(0.2), target2=pl.lit(0.2))
    motion = changed(folder, tmp_path, still)["motion"]
    assert (motion.severity, motion.joints) == (Severity.DOUBTFUL, ("elbow",))
    short = changed(folder, tmp_path, table.head(500))
    assert list(short) == ["targets", "motion"]
    assert short["motion"].severity is Severity.WRONG


def test_zeros_beyond_the_limits_are_doubtful(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    findings = changed(folder, tmp_path, table, "position_offset = [0.0, 2.5]\n")
    assert findings["limits"].severity is Severity.DOUBTFUL
    assert "elbow is at" in findings["limits"].says


@pytest.mark.parametrize(
    ("actuator", "says"),
    [
        ("stiffness = [12.0, 8.0]", "the stiffness that the robot file states (shoulder, elbow)"),
        (
            'stiffness = [12.0, "identify"]',
            "the stiffness that the robot file states (shoulder); the masses of the model file "
            "(elbow)",
        ),
        ('stiffness = ["identify", "identify"]', "the masses of the model file (shoulder, elbow)"),
        ("armature = 0.004", "a torque that the robot file states (shoulder, elbow)"),
    ],
)
def test_the_source_of_the_scale_is_named(
    folder: Path, tmp_path: Path, actuator: str, says: str
) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    scale = changed(folder, tmp_path, table, f"[actuator]\n{actuator}\n")["scale"]
    assert scale.answered and scale.says == says


def test_links_that_hardly_load_any_joint_give_no_scale(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    changed(folder, tmp_path, table)
    text = (tmp_path / "servos.urdf").read_text()
    light = text.replace('mass value="0.25"', 'mass value="2e-4"')
    light = light.replace('mass value="0.2"', 'mass value="2e-4"')
    (tmp_path / "servos.urdf").write_text(light)
    scale = found(tmp_path / "servos.toml", tmp_path / "log.csv")["scale"]
    assert scale.severity is Severity.DOUBTFUL and "hardly loads any joint" in scale.says
    level = ROBOT_FILE.replace("[robot]", "[robot]\ngravity = [0.0, 0.0, 0.0]")
    (tmp_path / "servos.toml").write_text(level)
    without = found(tmp_path / "servos.toml", tmp_path / "log.csv")
    assert without["scale"].severity is Severity.DOUBTFUL
    for name in ("signs", "joint zeros"):
        assert not without[name].answered and "shoulder, elbow" in without[name].says
    (tmp_path / "servos.toml").write_text(level + "[actuator]\narmature = 0.02\n")
    assert not found(tmp_path / "servos.toml", tmp_path / "log.csv")["scale"].severity


def test_positions_that_are_not_of_the_targets_are_doubtful(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    walk = 0.01 * np.random.default_rng(0).standard_normal(len(table)).cumsum()
    findings = changed(folder, tmp_path, table.with_columns(q2=pl.Series(0.1 * walk)))
    assert findings["targets"].severity is Severity.DOUBTFUL
    assert "positions of elbow do not follow the targets" in findings["targets"].says


def test_logs_are_named_as_they_were_given_and_none_twice(folder: Path, tmp_path: Path) -> None:
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
    text = (folder / "servo_fit.csv").read_text().splitlines()
    (tmp_path / "a" / "log.csv").write_text("\n".join(text[:1500]))
    (tmp_path / "b" / "log.csv").write_text("\n".join([text[0], *text[1500:]]))
    logs = [tmp_path / place / "log.csv" for place in ("a", "b")]
    result = steelyard.check_targets(folder / "servos.toml", logs)
    assert [f.log for f in result.last.findings][:2] == [str(log) for log in logs]
    with pytest.raises(LogError, match="twice"):
        steelyard.check_targets(folder / "servos.toml", [logs[0], logs[0]])


def test_the_command_prints_json_writes_a_page_and_refuses_what_needs_efforts(
    folder: Path, tmp_path: Path
) -> None:
    robot, log = str(folder / "servos.toml"), str(folder / "servo_fit.csv")
    done = CliRunner().invoke(app, ["check", robot, log, "-o", str(tmp_path / "page")])
    assert done.exit_code == 0 and "steelyard identify" in done.output
    assert "Where are the model file" in (tmp_path / "page" / "check.html").read_text("utf-8")
    told = CliRunner().invoke(app, ["check", robot, log, "--json"])
    assert '"signs"' in told.output and told.exit_code == 0
    for option in (["--fix", "new.toml"], ["--quick"]):
        refused = CliRunner().invoke(app, ["check", robot, log, *option])
        assert refused.exit_code == 2 and "is for identification from efforts" in refused.output


@pytest.mark.parametrize("command", ["check", "identify"])
def test_a_bare_model_file_and_targets_ask_for_a_robot_file(folder: Path, command: str) -> None:
    arguments = [str(folder / "servos.urdf"), str(folder / "servo_fit.csv")]
    done = CliRunner().invoke(app, [command, *arguments])
    assert done.exit_code == 2
    assert "position targets (target1, target2) and no efforts" in done.output
    assert "steelyard init MODEL LOG" in " ".join(done.output.split())


def test_exchanged_lists_of_positions_and_targets_are_doubtful(
    folder: Path, tmp_path: Path
) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    names = {"q1": "target1", "target1": "q1", "q2": "target2", "target2": "q2"}
    targets = changed(folder, tmp_path, table.rename(names))["targets"]
    assert targets.severity is Severity.DOUBTFUL
    assert "positions of shoulder, elbow come before their targets" in targets.says

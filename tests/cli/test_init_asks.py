"""`steelyard init` at a terminal: its questions, and what comes of the answers."""

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner, Result

from cli.conftest import Command
from cli.mistakes import LOG
from steelyard.cli import drive_questions as ask
from steelyard.cli import init_command
from steelyard.cli.app import app
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.init.draft_tables import Effort, Known, with_effort
from steelyard.robot.init.guess_columns import guess_columns
from steelyard.robot.robot import Coordinate

URDF = "../given/demo_arm.urdf"
TWO = (Coordinate("joint1", "revolute"), Coordinate("joint2", "revolute"))
TORQUES = guess_columns(TWO, ["t", "q1", "q2", "tau1", "tau2"])
CURRENTS = guess_columns(TWO, ["t", "q1", "q2", "current1_A", "current2_A"])
MOTORS = guess_columns(TWO, ["t", "q_motor1", "q_motor2", "tau_motor1", "tau_motor2"])


def answers(*given: str) -> Callable[[str, str], str]:
    left = list(given)

    def answer(question: str, default: str) -> str:
        return left.pop(0) or default

    return answer


def test_every_question_can_be_skipped() -> None:
    assert ask.effort_of(TORQUES, answers("")) is None
    assert ask.gears_of(MOTORS, TWO, answers("")) is None
    assert ask.mounting_of(answers("")) is None
    assert ask.coupling_of(TWO, answers("")) == () and ask.zeros_of(TWO, answers("")) == ()
    assert ask.with_gains(Known(), CURRENTS, TWO, answers("")) == Known()


def test_answers_are_understood() -> None:
    assert ask.effort_of(TORQUES, answers("6", "2")) == Effort("link_torque")
    behind = with_effort(TORQUES, Effort("link_torque"))
    assert ask.effort_of(behind, answers("")) is None
    assert ask.effort_of(behind, answers("1")) == Effort("joint_torque")
    gears = ask.gears_of(MOTORS, TWO, answers("100", "100, zero", "100, -50"))
    assert gears is not None and gears.ratios == (100.0, -50.0)
    coupling = answers("joint2", "joint2,joint9,32", "motor_2,joint1,32 joint1,joint2,-3")
    assert ask.coupling_of(TWO, coupling) == ((1, 0, 32.0), (0, 1, -3.0))
    zeros = ask.zeros_of(TWO, answers("90deg", "x,0", "-90deg, 0.5"))
    assert zeros == pytest.approx((-np.pi / 2, 0.5))
    assert ask.mounting_of(answers("ceiling")) == (0.0, 0.0, 9.81)
    assert ask.mounting_of(answers("wall", "0 0 0", "9.81,0,0")) == (9.81, 0.0, 0.0)
    known = ask.with_gains(Known(), CURRENTS, TWO, answers("12 0", "12 -9.5"))
    assert known.gains == (12.0, -9.5)


def test_what_the_columns_contain_is_not_asked() -> None:
    assert ask.effort_of(CURRENTS, answers()) is None
    assert ask.effort_of(MOTORS, answers()) is None
    known = Known(gains=(1.0, 2.0))
    assert ask.with_gains(known, CURRENTS, TWO, answers()) == known
    assert ask.with_gains(Known(), TORQUES, TWO, answers()) == Known()


def at_terminal(command: Sequence[str], given: Sequence[str]) -> tuple[int, str]:
    """Exit code and output of a command in a pseudo-terminal, answered line by line."""
    import pty

    process, terminal = pty.fork()
    if process == 0:  # pragma: no cover
        os.execv(sys.executable, [sys.executable, "-m", "steelyard", *command])
    os.write(terminal, "".join(f"{line}\n" for line in given).encode())
    said = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:
            break
        if not part:
            break
        said += part
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), said.decode()


@pytest.mark.slow
@pytest.mark.usefixtures("command")
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_at_a_terminal_answers_go_into_the_file(tmp_path: Path) -> None:
    robot = tmp_path / "arm.toml"
    given = ["3", "100,100,100", "ceiling"]
    code, said = at_terminal(["init", str(URDF), str(LOG), "-o", str(robot)], given)
    assert code == 0, said
    assert "What do the effort columns contain?" in said and "(Enter: upright)" in said
    loaded = load_robot(robot)
    assert loaded.signals is not None and loaded.signals.effort_kind == "motor_current"
    np.testing.assert_array_equal(loaded.signals.gains, 100.0)
    np.testing.assert_array_equal(loaded.robot.gravity, [0.0, 0.0, 9.81])


def answering(patch: pytest.MonkeyPatch, words: Sequence[object], given: Sequence[str]) -> Result:
    """A command in this process, which takes its input and output for a terminal."""
    terminal = SimpleNamespace(isatty=lambda: True)
    patch.setattr(init_command, "sys", SimpleNamespace(stdin=terminal, stdout=terminal))
    lines = "".join(f"{line}\n" for line in given)
    return CliRunner().invoke(app, [str(word) for word in words], input=lines)


@pytest.mark.usefixtures("command")
def test_signals_of_motors_are_asked_for_ratios_coupling_and_zeros(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {f"q{k}_rad": f"q_motor{k}_rad" for k in range(1, 4)}
    names |= {f"tau{k}_Nm": f"tau_motor{k}_Nm" for k in range(1, 4)}
    log, robot = tmp_path / "motors.csv", tmp_path / "arm.toml"
    pl.read_csv(LOG).drop("dq1_rad_s", strict=False).rename(names).write_csv(log)
    last, first = (load_robot(Path(URDF)).robot.joint_names[k] for k in (-1, 0))
    given = ["1,1,-1", f"{last},{first},0.5", "0,-90deg,1.5", ""]
    done = answering(monkeypatch, ["init", URDF, log, "-o", robot], given)
    assert done.exit_code == 0, done.output
    loaded = load_robot(robot)
    assert loaded.robot.transmission is not None and loaded.signals is not None
    matrix = np.diag([1.0, 1.0, -1.0])
    matrix[2, 0] = 0.5
    np.testing.assert_array_equal(loaded.robot.transmission.matrix, matrix)
    assert loaded.signals.position_offset == pytest.approx([0.0, -np.pi / 2, 1.5])


@pytest.mark.usefixtures("command")
def test_no_input_asks_nothing_at_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["init", URDF, LOG, "-o", tmp_path / "arm.toml"]
    assert "Enter:" in answering(monkeypatch, words, []).output
    done = answering(monkeypatch, [*words, "--no-input"], [])
    assert done.exit_code == 0 and "Enter:" not in done.output


def test_currents_without_gains_are_up_to_one_scale(command: Command, tmp_path: Path) -> None:
    rows = pl.read_csv(LOG)
    names = {f"tau{k}_Nm": f"current{k}_A" for k in range(1, 4)}
    log, robot = tmp_path / "run 1.parquet", tmp_path / "arm.toml"
    rows.rename(names).write_parquet(log)
    shown = command("init", URDF, log, "-o", robot)
    assert shown.exit_code == 0 and "Enter:" not in shown.stdout
    assert "gains unknown: the log does not contain Nm per A" in shown.stdout
    assert f"steelyard check {robot} '{log}'" in shown.stdout
    loaded = load_robot(robot)
    assert loaded.signals is not None and sum(loaded.signals.unknown_gains) == 2
    assert not loaded.signals.unknown_gains[1]  # the shoulder carries the arm
    assert "--loaded LOADED_LOG --payload-mass KG" in robot.read_text()


def test_friction_is_chosen_where_the_logs_allow_it(command: Command, tmp_path: Path) -> None:
    t = np.arange(0.0, 20.0, 0.01)
    rows = {"t": t} | {f"q{k}": 0.3 * np.sin((0.5 + 0.1 * k) * t) for k in range(1, 4)}
    rows |= {f"tau{k}": rows[f"q{k}"] for k in range(1, 4)}
    pl.DataFrame(rows).write_csv(tmp_path / "long.csv")
    shown = command("init", URDF, tmp_path / "long.csv", "-o", tmp_path / "long.toml")
    assert 'friction  "auto"' in shown.stdout
    assert load_robot(tmp_path / "long.toml").friction
    assert '"auto_memoryless"' in (tmp_path / "long.toml").read_text()
    short = command("init", URDF, LOG, "-o", tmp_path / "short.toml")
    assert 'for "auto"' in short.stdout and "needed)" in short.stdout
    loaded = load_robot(tmp_path / "short.toml")
    assert not loaded.friction and loaded.terms is not None and len(loaded.terms) == 5


def test_a_log_with_other_columns_is_refused(command: Command, tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    pl.read_csv(LOG).drop("tau1_Nm").write_csv(other)
    done = command("init", URDF, LOG, other, "-o", tmp_path / "arm.toml")
    assert done.exit_code == 2 and "lacks columns of the first log: tau1_Nm" in done.stderr


def test_the_last_of_several_logs_validates(command: Command, tmp_path: Path) -> None:
    robot, other = tmp_path / "arm.toml", "../given/validation.csv"
    shown = command("init", URDF, LOG, other, "-o", robot).stdout
    assert f"      steelyard check {robot} {LOG} {other}\n" in shown
    assert (
        f"identify; the last log validates the model:\n      steelyard identify {robot} " in shown
    )
    assert shown.endswith(f"{LOG} --validate {other}\n")
    one = command("init", URDF, LOG, "-o", tmp_path / "one.toml").stdout
    why = (
        "the end of the log validates the model; rows after 3.1 s are left out: the motion repeats"
    )
    assert f"# if no error is found, identify; {why}:\n" in one
    parts = f"{LOG}@0:2.4 --validate {LOG}@2.4:3.1"
    assert one.endswith(f"      steelyard identify {tmp_path / 'one.toml'} {parts}\n")
    rows = command("init", URDF, f"{LOG}#100:900", "-o", tmp_path / "rows.toml").stdout
    assert "# if no error is found, identify; --validate OTHER_LOG validates the model:" in rows
    assert rows.endswith(f"steelyard identify {tmp_path / 'rows.toml'} '{LOG}#100:900'\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "what"),
    [("tau2_Nm", "shoulder", "efforts"), ("q2_rad", "angle", "positions")],
)
def test_an_odd_name_leaves_the_others_in_the_template(
    command: Command, tmp_path: Path, old: str, new: str, what: str
) -> None:
    log, robot = tmp_path / "odd.csv", tmp_path / "arm.toml"
    pl.read_csv(LOG).rename({old: new}).write_csv(log)
    shown = command("init", URDF, log, "-o", robot)
    joint = load_robot(Path(URDF)).robot.joint_names[1]
    assert shown.exit_code == 1
    assert f"no column is recognised as that of {joint} (perhaps {new})" in shown.stdout
    assert "with a column in place of each ?" in shown.stdout
    columns = {"positions": "q{}_rad", "efforts": "tau{}_Nm"}
    text = robot.read_text()
    for quantity, pattern in columns.items():
        names = [pattern.format(k) for k in (1, 2, 3)]
        names[1] = "?" if quantity == what else names[1]
        assert str(names).replace("'", '"') in text
    filled = text.replace('"?"', f'"{new}"')
    lines = filled.split("\n")
    start = lines.index("# [signals]")
    end = lines.index("", start)
    lines[start:end] = [line.removeprefix("# ") for line in lines[start:end]]
    robot.write_text("\n".join(lines))
    assert load_robot(robot).signals is not None
    assert command("check", robot, log, "--quick").exit_code == 0


def test_the_template_has_the_currents_that_are_recognised(
    command: Command, tmp_path: Path
) -> None:
    names = {"tau1_Nm": "current1_A", "tau2_Nm": "drive_b", "tau3_Nm": "current3_A"}
    log, robot = tmp_path / "odd.csv", tmp_path / "arm.toml"
    pl.read_csv(LOG).rename(names).write_csv(log)
    assert command("init", URDF, log, "-o", robot).exit_code == 1
    text = robot.read_text()
    assert '# columns = ["current1_A", "?", "current3_A"]' in text
    assert '# kind = "motor_current"' in text and '# unit = ["A", "A", "A"]' in text
    assert '# gain = [1.0, "identify", "identify"]' in text


def test_a_template_names_no_columns_that_the_log_lacks(command: Command, tmp_path: Path) -> None:
    robot = tmp_path / "arm.toml"
    pl.read_csv(LOG).drop("q1_rad").write_csv(tmp_path / "five.csv")
    shown = command("init", URDF, tmp_path / "five.csv", "-o", robot)
    assert shown.exit_code == 1
    assert "positions are q2_rad, q3_rad, but no column is recognised as that of" in shown.stdout
    lines = [line.removeprefix("# ") for line in robot.read_text().splitlines()]
    assert 'time = "time_s"' in lines
    assert 'columns = ["tau1_Nm", "tau2_Nm", "tau3_Nm"]' in lines
    assert any(line.startswith('position = ["?", "q2_rad", "q3_rad"]') for line in lines)
    assert '"link_torque": sensors' in robot.read_text()


def test_limits_of_motions_are_those_of_the_model(command: Command, tmp_path: Path) -> None:
    robot = tmp_path / "arm.toml"
    command("init", URDF, LOG, "-o", robot)
    text = robot.read_text()
    part = text[text.index("[excitation.limits]") :]
    for key in ("velocity", "effort", "acceleration"):
        part = part.replace(f"# {key} = ", f"{key} = ")
    robot.write_text(text[: text.index("[excitation.limits]")] + part)
    loaded = load_robot(robot)
    limits = loaded.excitation.limits
    assert limits.velocity == tuple(c.limits.velocity for c in loaded.robot.coordinates)
    assert limits.effort == tuple(c.limits.effort for c in loaded.robot.coordinates)

"""`steelyard check`: verdicts, exit codes, new robot files, the page; with stubs of checks."""

import json
import shutil
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import ClassVar

import numpy as np
import polars as pl
import pytest

from browser import Tab, look
from cli.conftest import Command
from cli.mistakes import LOG, ROBOT
from cli.river_files import edited
from steelyard.check.cases_and_checks import Case
from steelyard.check.finding import Edit, Finding, Fix, Picture, Severity, Trace
from steelyard.cli.options_with_several_values import expanded
from steelyard.robot.file.robot_file import load_robot

EXAMINE = import_module("steelyard.check.all_checks")

OTHER = "../given/validation.csv"


@dataclass(frozen=True)
class Unit:
    """Positions of more than 1 rad, or another bound, are degrees."""

    name: ClassVar[str] = "position unit"
    question: ClassVar[str] = "Are positions in radians?"
    quick: ClassVar[bool] = True
    severity: Severity = Severity.WRONG
    bound: float = 1.0

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        return tuple(self.one(case, number) for number in range(len(case.logs)))

    def one(self, case: Case, number: int) -> Finding:
        log = case.logs[number]
        t, q = log.overview.t, log.overview.q
        reach = float(np.nanmax(np.abs(q)))
        picture = Picture("time [s]", "position [rad]", (Trace("joint", t, q[:, 0]),))
        if reach < self.bound:
            return Finding(self.name, log.name, Severity.OK, "within a turn", f"{reach:.2f} rad")
        away = Edit(("signals", "position_offset"), None)
        fix = Fix("they are in degrees", (Edit(("signals", "position_unit"), "deg"), away))
        says, figure = "positions go around", f"{reach:.0f} rad, bound 1 rad"
        return Finding(
            self.name, log.name, self.severity, says, figure, case.joints[:1], fix, picture
        )


@dataclass(frozen=True)
class Slow:
    """Keeps the cases that it saw, and has nothing to say."""

    name: ClassVar[str] = "slow"
    question: ClassVar[str] = "What is there?"
    quick: ClassVar[bool] = False
    seen: list[Case] = field(default_factory=list)

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        self.seen.append(case)
        return ()


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Slow:
    """Stubs instead of the checks."""
    return asking(monkeypatch, Severity.WRONG)


def asking(monkeypatch: pytest.MonkeyPatch, severity: Severity, bound: float = 1.0) -> Slow:
    slow = Slow()
    monkeypatch.setattr(EXAMINE, "CHECKS", (Unit(severity, bound), slow))
    return slow


@pytest.fixture
def degrees(given: Path, tmp_path: Path) -> Path:
    """A log whose positions are in degrees, which its robot file does not say."""
    table = pl.read_csv(given / "identification.csv")
    turned = [pl.col(c).degrees() for c in table.columns if c.startswith("q")]
    table.with_columns(turned).write_parquet(tmp_path / "degrees.parquet")
    return tmp_path / "degrees.parquet"


@pytest.fixture
def robot(given: Path, tmp_path: Path) -> Path:
    return edited(given, tmp_path, ('"q{}_rad"', '"q{}_rad"  # by the encoders'))


def words(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize(("severity", "code"), [(Severity.DOUBTFUL, 1), (Severity.WRONG, 2)])
def test_the_worst_judgement_is_the_exit_code(
    severity: Severity,
    code: int,
    degrees: Path,
    command: Command,
    monkeypatch: pytest.MonkeyPatch,
    work: Path,
) -> None:
    asking(monkeypatch, severity)
    good = command("check", ROBOT, LOG, OTHER, "-v")
    assert good.exit_code == 0 and good.stderr == ""
    assert "ok position unit 2 logs: within a turn" in words(good.stdout)
    step = f"next        steelyard identify {ROBOT} {LOG} --validate {OTHER}"
    assert good.stdout.rstrip().endswith(f"Ok: no error was found\n\n{step}")
    short = words(command("check", ROBOT, LOG, OTHER).stdout)
    said = "ok 1 check position unit Ok: no error was found"
    assert short == f"{said} {words(step)}"
    one = command("check", ROBOT, LOG).stdout.rstrip()
    assert one.endswith(f"steelyard identify {ROBOT} {LOG}@0:2.4 --validate {LOG}@2.4:3.1")
    both = words(command("check", ROBOT, degrees, LOG).stdout)
    assert "give degrees a robot file of its own" in both
    assert f"(1 check: 1 {severity.word})" in both
    bad = command("check", ROBOT, degrees)
    assert bad.exit_code == code
    shown = words(bad.stdout)
    assert f"{severity.word} position unit degrees: shoulder_turn: positions go around" in shown
    assert 'they are in degrees [signals] position_unit = "deg"' in shown
    assert "--fix writes a new robot file" in shown and "-o FOLDER" in shown
    assert "steelyard identify" not in shown
    assert not any(work.iterdir())


def test_fix_writes_a_new_robot_file_and_checks_again(
    slow: Slow, robot: Path, degrees: Path, command: Command
) -> None:
    before = robot.read_text()
    done = command("check", robot, degrees, "--fix")
    fixed = robot.parent / "arm-fixed.toml"
    assert done.exit_code == 0, done.output
    assert robot.read_text() == before
    assert fixed.read_text() == before.replace(
        "# by the encoders\n", "# by the encoders\n", 1
    ).replace('velocity = "dq{}_rad_s"\n', 'velocity = "dq{}_rad_s"\nposition_unit = "deg"\n')
    shown = words(done.stdout)
    change = '[signals] position_unit = "deg" position unit, degrees: shoulder_turn: positions go'
    assert f"differs: {change}" in shown and "Checked again with" in shown
    assert shown.index("Wrong: position unit") < shown.index("Ok: no error")
    hints = f"robot file {fixed} -o FOLDER writes a page with the plots"
    cut = f"{degrees}@0:2.4 --validate {degrees}@2.4:3.1"
    why = "# rows after 3.1 s are left out: the motion repeats"
    assert shown.endswith(f"{hints} next {why} steelyard identify {fixed} {cut}")
    assert command("check", fixed, degrees).exit_code == 0
    again = command("check", robot, degrees, "--fix")
    assert again.exit_code == 2 and "the robot file to write exists already" in again.stderr
    assert [
        case.loaded.signals.position_scale[0] for case in slow.seen[:2] if case.loaded.signals
    ] == [
        1.0,
        pytest.approx(np.pi / 180.0),
    ]


def test_fix_elsewhere_still_finds_the_model(
    slow: Slow, robot: Path, degrees: Path, command: Command, tmp_path: Path
) -> None:
    (tmp_path / "there").mkdir()
    target = tmp_path / "there" / "mine.toml"
    done = command("check", robot, degrees, "--fix", target, "--json")
    printed = json.loads(done.stdout)
    assert printed["severity"] == "wrong" and done.exit_code == 0
    assert printed["fixed"]["robot_file"] == str(target) and printed["fixed"]["severity"] == "ok"
    assert printed["fixed"]["changes"] == [
        {
            "path": ["signals", "position_unit"],
            "value": "deg",
            "check": "position unit",
            "says": "positions go around",
        }
    ]
    assert 'urdf = "../demo_arm.urdf"' in target.read_text()
    assert load_robot(target).robot.n == 3


def test_fix_of_a_bare_model_writes_a_whole_robot_file(
    slow: Slow, robot: Path, given: Path, command: Command, tmp_path: Path
) -> None:
    target = tmp_path / "new.toml"
    table = pl.read_csv(given / "identification.csv")
    turned = [(pl.col(c) * 30.0).alias(c) for c in table.columns if c.startswith("q")]
    table.with_columns(turned).write_csv(tmp_path / "far.csv")
    done = command("check", robot.parent / "demo_arm.urdf", tmp_path / "far.csv", "--fix", target)
    assert "note: time is 'time_s' in s, by its name" in words(done.stdout)
    signals = load_robot(target).signals
    assert signals is not None
    np.testing.assert_allclose(signals.position_scale, np.pi / 180.0)
    assert "CHECK: the columns of the log" in target.read_text()


def test_a_robot_file_without_signals_gets_them(
    slow: Slow, robot: Path, degrees: Path, command: Command
) -> None:
    text = robot.read_text()
    robot.write_text(text[: text.index("[signals]")])
    done = command("check", robot, degrees, "--fix")
    assert done.exit_code == 0, done.output
    signals = load_robot(robot.parent / "arm-fixed.toml").signals
    assert signals is not None and signals.effort[2] == "tau3_Nm"


@dataclass(frozen=True)
class Unmendable:
    """Finds wrong what is given, by whether positions are in degrees."""

    name: ClassVar[str] = "gain"
    question: ClassVar[str] = "Are gains right?"
    quick: ClassVar[bool] = False
    wrong_before: bool

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        assert case.loaded.signals is not None
        fixed = float(case.loaded.signals.position_scale[0]) != 1.0
        severity = Severity.WRONG if fixed or self.wrong_before else Severity.OK
        return (Finding(self.name, "", severity, "gains", "none"),)


@pytest.mark.parametrize("wrong_before", [True, False])
def test_a_fix_that_makes_something_wrong_is_not_written(
    wrong_before: bool,
    robot: Path,
    degrees: Path,
    command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stubs = (Unit(), Unmendable(wrong_before))
    monkeypatch.setattr(EXAMINE, "CHECKS", stubs)
    done = command("check", robot, degrees, "--fix")
    assert done.exit_code == 2
    assert (robot.parent / "arm-fixed.toml").exists() == wrong_before
    assert ("No robot file is written" in done.stdout) != wrong_before
    assert ("the check finds gain wrong" in words(done.stdout)) != wrong_before


def test_what_has_no_line_is_named(
    robot: Path, given: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    stubs = (Unmendable(True),)
    monkeypatch.setattr(EXAMINE, "CHECKS", stubs)
    done = command("check", robot, given / "identification.csv", "--fix")
    assert "gain: no line of the robot file is known to correct it" in words(done.stdout)


def test_stamps_that_cannot_be_read_are_no_empty_window(
    robot: Path, given: Path, command: Command, tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    rows = pl.read_csv(given / "identification.csv")
    rows.with_columns(pl.lit(None, pl.Float64).alias(rows.columns[0])).write_csv(log)
    done = command("check", robot, f"{log}@1:3")
    assert done.exit_code == 2 and "never increases: it is not a clock" in words(done.stdout)


def test_nothing_to_correct_writes_no_file(
    slow: Slow, robot: Path, command: Command, given: Path
) -> None:
    done = command("check", robot, given / "identification.csv", "--fix")
    assert done.exit_code == 0 and "No robot file is written" in done.stdout
    assert not (robot.parent / "arm-fixed.toml").exists()


@pytest.mark.parametrize(
    ("line", "result"),
    [
        ("check r.toml a.csv --fix", "check r.toml a.csv --fix="),
        ("check r.toml a.csv --fix b.toml", "check r.toml a.csv --fix b.toml"),
        ("check r.toml --fix a.csv", "check r.toml --fix= a.csv"),
        ("check --fix r.toml a.csv", "check --fix= r.toml a.csv"),
        ("check r.toml a.csv --fix=b.toml", "check r.toml a.csv --fix=b.toml"),
    ],
)
def test_fix_takes_a_robot_file_behind_it(line: str, result: str) -> None:
    assert expanded(line.split()) == result.split()


def test_json_has_its_schema(slow: Slow, degrees: Path, command: Command) -> None:
    done = command("check", ROBOT, f"{degrees}@1:3", "--json")
    printed = json.loads(done.stdout)
    assert done.exit_code == 2
    assert list(printed) == [
        *("robot", "logs", "model", "severity", "findings", "edits", "notes", "fixed", "output"),
    ]
    assert printed["robot"] == ROBOT and printed["logs"] == [f"{degrees}@1:3"]
    assert (printed["model"], printed["fixed"], printed["output"]) == (None, None, None)
    finding = printed["findings"][0]
    assert finding["log"] == "degrees@1:3" and finding["joints"] == ["shoulder_turn"]
    assert finding["fix"]["lines"] == '[signals]\nposition_unit = "deg"'
    assert printed["edits"] == finding["fix"]["edits"]


@pytest.mark.slow
def test_the_output_is_a_page_and_json(
    slow: Slow, degrees: Path, command: Command, browser: Tab, tmp_path: Path
) -> None:
    done = command("check", ROBOT, degrees, OTHER, "-o", tmp_path / "out", "--json")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["check.html", "check.json"]
    printed = json.loads((tmp_path / "out" / "check.json").read_text())
    assert printed | {"output": str(tmp_path / "out")} == json.loads(done.stdout)
    again = command("check", ROBOT, degrees, "-o", tmp_path / "out")
    assert again.exit_code == 2 and "the output folder exists already" in again.stderr
    seen = look(browser, tmp_path / "out" / "check.html")
    assert seen.console == () and seen.errors == []
    assert seen.dom.count('class="picture js-plotly-plot"') == 1
    assert 'title="Are positions in radians?"' in seen.dom


def test_logs_that_cannot_be_read_are_findings(
    slow: Slow, given: Path, command: Command, tmp_path: Path
) -> None:
    pl.read_csv(given / "identification.csv").drop("q2_rad").write_csv(tmp_path / "few.csv")
    pl.read_csv(given / "validation.csv").write_parquet(tmp_path / "torn.parquet")
    whole = (tmp_path / "torn.parquet").read_bytes()
    (tmp_path / "torn.parquet").write_bytes(whole[:20_000])
    header = given / "header.csv"
    done = command("check", ROBOT, tmp_path / "few.csv", header, OTHER, "--json")
    printed = {(f["check"], f["log"]): f for f in json.loads(done.stdout)["findings"]}
    assert done.exit_code == 2 and list(printed) == [
        *(("log", "few"), ("log", "header"), ("position unit", "validation")),
    ]
    assert "no column 'q2_rad'" in printed["log", "few"]["says"]
    assert "rows" in printed["log", "header"]["says"]
    torn = command("check", ROBOT, tmp_path / "torn.parquet", OTHER)
    assert torn.exit_code == 2 and isinstance(torn.exception, SystemExit)


@pytest.mark.parametrize("window", ["@9000:9100", "#900000:"])
def test_a_window_beside_the_log_is_no_log(window: str, command: Command, given: Path) -> None:
    done = command("check", ROBOT, f"{given / 'identification.csv'}{window}", "--json")
    (found,) = json.loads(done.stdout)["findings"]
    assert done.exit_code == 2 and found["check"] == "log" and found["severity"] == "wrong"
    rows = len(pl.read_csv(given / "identification.csv"))
    assert f"the window {window} holds no row: the log lasts" in found["says"]
    assert f"({rows} rows)" in found["says"]


@pytest.mark.parametrize(("log", "code"), [("static.csv", 2), ("broken.csv", 2), ("soiled.csv", 0)])
def test_logs_of_which_little_can_be_used(
    log: str, code: int, command: Command, given: Path
) -> None:
    done = command("check", ROBOT, given / log)
    assert done.exit_code == code and done.stderr == ""
    assert done.exception is None or isinstance(done.exception, SystemExit)


def test_names_of_one_file_in_two_folders_stay_apart(
    slow: Slow, given: Path, command: Command, tmp_path: Path
) -> None:
    paths = [tmp_path / name / "run.csv" for name in ("monday", "tuesday")]
    for path in paths:
        path.parent.mkdir()
        shutil.copy(given / "validation.csv", path)
    printed = json.loads(command("check", ROBOT, *paths, "--json").stdout)
    assert [finding["log"] for finding in printed["findings"]] == ["monday/run", "tuesday/run"]


def test_what_the_suspicions_get_to_see(
    slow: Slow, identified: Path, given: Path, command: Command, tmp_path: Path
) -> None:
    robot = edited(given, tmp_path, ('velocity = "dq{}_rad_s"\n', ""))
    command("check", robot, OTHER, "--model", identified)
    command("check", ROBOT, OTHER, "--quick")
    (case,) = slow.seen
    assert case.reference is not None and case.reference.model.robot.n == 3
    assert case.guesses == {"velocity": tuple(f"dq{k}_rad_s" for k in range(1, 4))}
    command("check", ROBOT, OTHER)
    assert slow.seen[1].guesses == {} and slow.seen[1].reference is None


def test_a_model_of_another_robot_is_refused(
    identified: Path, given: Path, command: Command, tmp_path: Path
) -> None:
    two = [f'"{name}"' for name in load_robot(given / "demo_arm.toml").robot.joint_names[:2]]
    change = (
        'urdf = "demo_arm.urdf"\n',
        f'urdf = "demo_arm.urdf"\njoints = [{", ".join(two)}]\n',
    )
    done = command("check", edited(given, tmp_path, change), OTHER, "--model", identified)
    assert done.exit_code == 2 and "elbow, the robot file of" in done.stderr


def test_help_has_an_example(command: Command) -> None:
    assert "Example: steelyard check" in command("check", "--help").stdout


@pytest.mark.slow
def test_identify_stops_at_what_is_wrong(
    slow: Slow, degrees: Path, command: Command, tmp_path: Path
) -> None:
    done = command("identify", ROBOT, degrees, "-o", tmp_path / "o")
    assert done.exit_code == 2 and not (tmp_path / "o").exists()
    message = words(done.stderr)
    assert "error: failed check, position unit: positions go around where degrees: " in message
    assert 'fix they are in degrees: [signals] position_unit = "deg"' in message
    assert f"`steelyard check {ROBOT} LOG... --fix` writes" in message and "--no-check" in message
    assert slow.seen == []


@pytest.mark.slow
def test_identify_notes_what_is_doubtful_and_reports_it(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asking(monkeypatch, Severity.DOUBTFUL, bound=0.0)
    done = command("identify", ROBOT, LOG, "-o", tmp_path / "o", "--json")
    printed = json.loads(done.stdout)
    assert done.exit_code == 0 and printed["check"]["severity"] == "doubtful"
    note = "check, position unit: identification: shoulder_turn: positions go around"
    assert any(one["says"].startswith(note) for one in printed["limitations"])
    page = (tmp_path / "o" / "report.html").read_text()
    assert "Doubtful: position unit" in page and 'class="picture"' in page

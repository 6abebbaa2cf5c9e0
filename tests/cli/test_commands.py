"""What the commands print and write."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import typer

import steelyard
from cli.conftest import Command
from cli.mistakes import LOG, PLAIN, ROBOT
from short_arm import without_wrist
from steelyard.cli.app import app
from steelyard.cli.options_with_several_values import expanded
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.simulate import simulate as demonstration

URDF = "../given/demo_arm.urdf"
OTHER = "../given/validation.csv"
JOINTS = ["shoulder_turn", "shoulder_lift", "elbow"]
FIGURES = (
    "relative_percent",
    "relative_percent_moving",
    "rmse",
    "mae",
    "predict_zero",
    "prior_rmse",
)


def strict(text: str) -> Any:
    """JSON without the NaN and Infinity that Python would let through."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize(
    "name", ["init", "excite", "identify", "validate", "simulate", "replay", "demo"]
)
def test_help_shows_an_example(name: str, command: Command) -> None:
    done = command(name, "--help")
    assert done.exit_code == 0
    assert f"Example: steelyard {name}" in done.stdout


def test_help_names_the_default_folder(command: Command) -> None:
    words = " ".join(command("identify", "--help").stdout.replace("│", " ").split())
    assert "If unset steelyard-ROBOT, or steelyard-ROBOT-2 and so on if that exists." in words


@pytest.mark.slow
def test_no_word_of_a_help_text_is_cut_at_80_columns(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    names = list(typer.main.get_command(app).commands)
    texts = {name: command(name, "--help").stdout for name in names}
    assert max(map(len, texts["track"].splitlines())) == 80
    assert [name for name in names if "…" in texts[name]] == [] and len(names) > 20


def test_help_does_not_swallow_brackets(command: Command) -> None:
    words = "".join(command("replay", "--help").stdout.split())
    assert 'pipinstall"steelyard[replay]"' in words
    assert "under." not in "".join(command("excite", "--help").stdout.split())


def test_help_names_all_commands_and_the_first_success(command: Command) -> None:
    words = command("--help").stdout.split()
    assert {"init", "identify", "validate", "simulate", "demo"} <= set(words)
    assert " ".join(words).endswith("First try: steelyard demo")


def test_without_a_command_there_is_help(command: Command) -> None:
    assert "Usage:" in command().output


def test_version(command: Command) -> None:
    assert command("--version").stdout == f"steelyard {steelyard.__version__}\n"


def test_the_module_runs_as_a_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "steelyard", "--version"], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, f"steelyard {steelyard.__version__}\n")


@pytest.mark.parametrize(
    ("given", "result"),
    [
        ("r a --validate b c -o out", "r a --validate b --validate c -o out"),
        ("r a --validate b --validate c", "r a --validate b --validate c"),
        ("r --json --validate b", "r --json --validate b"),
        ("r a --validate", "r a --validate"),
        ("r a --validate --json", "r a --json --validate"),
        ("r a --validate=b c", "r a --validate=b c"),
    ],
)
def test_options_that_take_several_values(given: str, result: str) -> None:
    assert expanded(given.split()) == result.split()


def test_identify_writes_model_parameters_and_report(identified: Path) -> None:
    names = sorted(path.name for path in identified.iterdir())
    assert names == ["model.json", "parameters.csv", "report.html"]
    model = strict((identified / "model.json").read_text())
    with (identified / "parameters.csv").open() as file:
        rows = list(csv.DictReader(file))
    values = {
        row["name"]: float(row["value"]) for row in rows if row["status"] != "not identifiable"
    }
    wanted = steelyard.load_model(identified).estimate.parameters.as_dict()
    assert {name: values[name] for name in wanted} == wanted
    assert len(rows) == len(steelyard.load_model(identified).base)
    assert set(model["provenance"]["inputs"]) >= {"robot demo_arm.toml", "robot demo_arm.urdf"}
    assert "<html" in (identified / "report.html").read_text()


def test_the_terminal_ends_with_the_paths(identified: Path) -> None:
    lines = (identified.parent / "terminal.txt").read_text().splitlines()
    assert lines[-2:] == [
        f"model   {identified / 'model.json'}",
        f"report  {identified / 'report.html'}",
    ]


def random_motion(n: int, samples: int = 40) -> steelyard.Motion:
    rng = np.random.default_rng(3)
    q, dq, ddq = rng.uniform(-2.0, 2.0, (3, samples, n))
    return steelyard.Motion(np.arange(samples) * 0.01, q, dq, ddq)


def test_models_round_trip_exactly(identified: Path, tmp_path: Path) -> None:
    model, motion = steelyard.load_model(identified), random_motion(3)
    (tmp_path / "again.json").write_text(model.text())
    again = steelyard.load_model(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (identified / "model.json").read_bytes()
    assert again.torque(motion).tobytes() == model.torque(motion).tobytes()
    assert again.estimate.covariance.tobytes() == model.estimate.covariance.tobytes()


def test_steps_agree_with_the_whole_motion(identified: Path) -> None:
    model, motion = steelyard.load_model(identified), random_motion(3)
    stepper = model.start()
    steps = [stepper.step(*x) for x in zip(motion.q, motion.dq, motion.ddq, strict=True)]
    np.testing.assert_allclose(steps, model.torque(motion), rtol=1e-12, atol=1e-12)


def test_validate_json_has_its_schema(identified: Path, command: Command) -> None:
    done = command("validate", identified, OTHER, f"{LOG}@1.5:4", "--json")
    runs = strict(done.stdout)
    assert [run["run"] for run in runs] == ["validation", "identification@1.5:4"]
    for run in runs:
        assert [joint["joint"] for joint in run["joints"]] == JOINTS
        assert all(joint["unit"] == "Nm" for joint in run["joints"])
        assert all(joint[figure] > 0.0 for joint in run["joints"] for figure in FIGURES)
        mean = np.mean([joint["relative_percent"] for joint in run["joints"]])
        assert run["mean_percent"] == pytest.approx(mean)
        for joint in run["joints"]:
            percent = 100.0 * joint["rmse"] / joint["predict_zero"]
            assert joint["relative_percent"] == pytest.approx(percent)


@pytest.mark.slow
def test_a_log_that_was_fitted_is_no_test(
    identified: Path, command: Command, tmp_path: Path
) -> None:
    runs = strict(command("validate", identified, OTHER, f"{LOG}@1.5:4", "--json").stdout)
    assert [run["fitted"] for run in runs] == [False, True]
    assert [run["verdict"]["level"] for run in runs] == ["good", "none"]
    shown = " ".join(command("validate", identified, f"{LOG}@1.5:4").stdout.split())
    assert "Not validated on unseen motion" in shown and ", fitted (RMS below 5 Hz" in shown
    assert "identification@1.5:4 was fitted: its score does not validate the model" in shown
    out = tmp_path / "part"
    assert command("identify", ROBOT, f"{LOG}@0:3.5", *PLAIN, "-o", out).exit_code == 0
    runs = strict(command("validate", out, f"{LOG}@3.5:6", f"{LOG}@3:6", "--json").stdout)
    assert [run["fitted"] for run in runs] == [False, True]


@pytest.mark.slow
def test_validate_says_what_identify_says(identified: Path, command: Command) -> None:
    printed = strict((identified.parent / "printed.json").read_text())
    again = strict(command("validate", identified / "model.json", OTHER, "--json").stdout)
    assert again[0]["joints"] == printed["validation"][0]["joints"]
    assert printed["verdict"]["level"] == "good" and again[0]["verdict"] == printed["verdict"]
    assert printed["n_base_parameters"] == len(printed["parameters"]) + len(printed["not_seen"])


def test_validate_writes_a_report_only_if_requested(
    identified: Path, command: Command, tmp_path: Path, work: Path
) -> None:
    assert command("validate", identified, OTHER).exit_code == 0
    assert not any(work.iterdir())
    done = command("validate", identified, OTHER, "-o", tmp_path / "seen")
    assert done.stdout.endswith(f"report  {tmp_path / 'seen' / 'report.html'}\n")
    assert (tmp_path / "seen" / "report.html").stat().st_size > 10_000


@pytest.mark.slow
def test_several_logs_to_validate(command: Command, tmp_path: Path) -> None:
    options = ("--validate", OTHER, f"{LOG}@4.1:7")
    arguments = (ROBOT, f"{LOG}#0:1000", *PLAIN, *options, "-o", tmp_path / "o", "--json")
    done = command("identify", *arguments)
    result = strict(done.stdout)
    assert result["output"] == str(tmp_path / "o") and result["check"] is None
    assert "Check of the logs" not in (tmp_path / "o" / "report.html").read_text()
    assert [run["run"] for run in result["validation"]] == ["validation", "identification@4.1:7"]
    assert [run["run"] for run in result["identification"]] == ["identification#0:1000"]
    assert [run["motion"] for run in result["identification"]] == ["fitted"]


@pytest.mark.slow
def test_an_effort_that_is_always_zero_has_no_percentage(
    identified: Path, given: Path, command: Command, tmp_path: Path
) -> None:
    table = pl.read_csv(given / "validation.csv")
    table.with_columns(pl.lit(0.0).alias("tau3_Nm")).write_csv(tmp_path / "dead.csv")
    runs = strict(command("validate", identified, tmp_path / "dead.csv", "--json").stdout)
    joint = runs[0]["joints"][2]
    assert joint["relative_percent"] is None
    assert joint["predict_zero"] == 0.0 < joint["rmse"]
    assert runs[0]["mean_percent"] is None
    assert command("validate", identified, tmp_path / "dead.csv").exit_code == 1
    words = "identify", ROBOT, LOG, "--validate", tmp_path / "dead.csv", "-o", tmp_path / "o"
    refused = command(*words)
    assert refused.exit_code == 2 and "never changes: it is not measured" in refused.stderr
    assert command(*words, *PLAIN).exit_code == 1


@pytest.mark.slow
def test_init_alone_and_with_a_log(command: Command, tmp_path: Path) -> None:
    alone, guessed = tmp_path / "alone.toml", tmp_path / "guessed.toml"
    shown = command("init", URDF, "-o", alone)
    assert shown.exit_code == 0 and f"wrote {alone}: 3 joints to identify" in shown.stdout
    assert f"steelyard excite {alone} -o motion" in shown.stdout
    assert "Columns are guessed from each log" in alone.read_text()
    assert shown.stdout.splitlines()[-1].endswith(f"steelyard identify {alone} LOG...")
    facts = strict(command("init", URDF, LOG, "-o", guessed, "--json").stdout)
    assert (facts["robot_file"], facts["joints"]) == (str(guessed), JOINTS)
    assert facts["columns_found"] and facts["complete"]
    assert not facts["without_columns"] and not facts["missing"]
    assert any("the side of the gears" in reason for reason in facts["guesses"])
    done = command("identify", guessed, LOG, *PLAIN, "-o", tmp_path / "o")
    assert done.exit_code == 0, done.output


def test_init_names_the_joints_of_hands_that_it_locks(command: Command, tmp_path: Path) -> None:
    arm = "<joint name='turn' type='hinge'/><geom size='.1'/>"
    fingers = "".join(
        f"<body pos='.1 {k} 0'><joint name='finger{k}'/><geom size='.1'/></body>" for k in range(8)
    )
    path = tmp_path / "arm.xml"
    path.write_text(f"<mujoco><worldbody><body>{arm}{fingers}</body></worldbody></mujoco>")
    shown = command("init", path, "-o", tmp_path / "arm.toml").stdout
    named = ", ".join(f"finger{k}" for k in range(6))
    assert f"note  locked {named} and 2 more (recognised as joints of a hand); " in shown


def test_init_says_each_statement_once(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(
        """<robot name="bare"><link name="base"/><link name="arm"/><link name="finger"/>
        <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/></joint>
        <joint name="finger_joint" type="continuous"><parent link="arm"/><child link="finger"/>
        </joint></robot>"""
    )
    notes = strict(command("init", path, "-o", tmp_path / "arm.toml", "--json").stdout)["notes"]
    (massless,) = (note for note in notes if "nominal mass is zero" in note)
    assert massless == "no inertial in the model, nominal mass is zero: arm"


def test_init_says_what_it_did_not_find(command: Command, tmp_path: Path) -> None:
    rows = pl.read_csv(LOG)
    rows.rename({name: f"x_{k}" for k, name in enumerate(rows.columns)}).write_csv(
        tmp_path / "unknown.csv"
    )
    names = {f"q{k + 1}_rad": f"{joint}_q" for k, joint in enumerate(JOINTS)}
    names |= {f"tau{k + 1}_Nm": f"{joint}_tau" for k, joint in enumerate(JOINTS)}
    rows.select("time_s", *names).rename(names).drop(f"{JOINTS[2]}_q").write_csv(
        tmp_path / "few.csv"
    )
    shown = command("init", URDF, tmp_path / "unknown.csv", "-o", tmp_path / "a.toml")
    assert shown.exit_code == 1 and "joints to identify" not in shown.stdout
    first, todo = shown.stdout.splitlines()[:2]
    assert first.startswith(f"wrote {tmp_path / 'a.toml'}, incomplete: the log's columns cannot")
    assert todo.startswith("to do fill in [signals]") and (tmp_path / "a.toml").is_file()
    rows.write_csv(tmp_path / "bare.csv", include_header=False)
    shown = command("init", URDF, tmp_path / "bare.csv", "-o", tmp_path / "d.toml")
    assert "the file seems to have no header line" in shown.stdout.splitlines()[0]
    shown = command("init", URDF, tmp_path / "few.csv", "-o", tmp_path / "b.toml")
    first = shown.stdout.splitlines()[0]
    assert shown.exit_code == 1 and first.endswith(f"the log has no columns of {JOINTS[2]}")
    facts = strict(
        command("init", URDF, tmp_path / "few.csv", "-o", tmp_path / "c.toml", "--json").stdout
    )
    assert (
        not facts["complete"]
        and facts["without_columns"] == [JOINTS[2]]
        and len(facts["joints"]) == 2
    )


@pytest.mark.slow
def test_a_urdf_alone_works_too(command: Command, tmp_path: Path) -> None:
    done = command("identify", URDF, LOG, "--no-check", "-o", tmp_path / "o", "--json")
    result = strict(done.stdout)
    assert len(result["identification"][0]["joints"]) == 3
    assert any("effort" in note or "tau" in note for note in result["notes"])


@pytest.mark.slow
def test_simulate_follows_a_motion(command: Command, tmp_path: Path) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    files = strict(
        command("simulate", ROBOT, "--period", "1", "--noise", "0", "-o", first, "--json").stdout
    )
    assert files == {
        "log": str(first / "log.csv"),
        "truth": str(first / "truth.json"),
        "trajectory": str(first / "trajectory.json"),
    }
    motion = first / "trajectory.json"
    done = command("simulate", ROBOT, "--motion", motion, "--noise", "0", "-o", again)
    assert done.exit_code == 0, done.output
    logs = [pl.read_csv(folder / "log.csv").to_numpy() for folder in (first, again)]
    np.testing.assert_allclose(logs[0], logs[1], rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_simulate_draws_by_its_seed(command: Command, tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        command("simulate", ROBOT, "--period", "1", "--seed", seed, "-o", tmp_path / name)
    a, b, c = ((tmp_path / name / "log.csv").read_bytes() for name in "abc")
    assert a == b != c
    truth = [(tmp_path / name / "truth.json").read_text() for name in "abc"]
    assert truth[0] == truth[1] != truth[2]


@pytest.mark.slow
@pytest.mark.usefixtures("searches_here")
def test_demo(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def quick_arm(folder: Path) -> LoadedRobot:
        without_wrist(folder)
        text = (folder / "demo_arm.toml").read_text("utf-8")
        for usual, quick in (
            ("period = 20.0", "period = 4.0"),
            ("harmonics = 16", "harmonics = 3"),
        ):
            assert usual in text
            text = text.replace(usual, quick)
        (folder / "demo_arm.toml").write_text(text, "utf-8")
        return load_robot(folder / "demo_arm.toml")

    monkeypatch.setattr(demonstration, "write_demo_arm", quick_arm)
    done = command("demo", "--seed", "3", "-o", tmp_path / "demo", "--json")
    result = strict(done.stdout)
    assert result["output"] == str(tmp_path / "demo" / "results")
    assert result["validation"][0]["mean_percent_moving"] < 5.0
    inside = [one["inside"] for one in result["truth"]]
    assert len(inside) > 20 and sum(inside) >= 0.8 * len(inside)
    page = (tmp_path / "demo" / "results" / "report.html").read_text("utf-8")
    assert '<section id="truth"' in page
    names = sorted(path.name for path in (tmp_path / "demo").iterdir())
    assert names == ["motion", "results", "robot"]
    assert result["motion"]["certified"] and not result["motion"]["stopped"]
    assert result["motion"]["searches"] == 2
    motion = sorted(path.name for path in (tmp_path / "demo" / "motion").iterdir())
    assert motion == ["certificate.json", "report.html", "trajectory.csv", "trajectory.json"]
    again = tmp_path / "demo" / "robot" / "demo_arm.toml"
    log = tmp_path / "demo" / "robot" / "validation.csv"
    assert command("identify", again, f"{log}@0:3", *PLAIN, "-o", tmp_path / "o").exit_code == 0

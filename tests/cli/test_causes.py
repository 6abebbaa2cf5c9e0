"""Whole identifications with parameters of single runs, motors' logs, effort kinds and gains."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from cli.conftest import Command
from cli.river_files import edited
from steelyard.base.errors import ModelError
from steelyard.model.laws.laws_without_friction import RotorInertia
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import load_runs

N = 3
RATIOS = np.diag([80.0, 100.0, -90.0])
RATIOS[2, 1] = 40.0
OFFSET = np.array([0.1, -0.2, 0.3])
Edit = Callable[..., Path]


@pytest.fixture
def edit(given: Path, tmp_path: Path) -> Edit:
    """The demo arm's robot file with some of its text replaced."""

    def replaced(*changes: tuple[str, str]) -> Path:
        return edited(given, tmp_path, *changes)

    return replaced


def identify(command: Command, robot: Path, *arguments: object) -> dict[str, object]:
    done = command(
        "identify", robot, *arguments, "--no-check", "-o", robot.parent / "out", "--json"
    )
    assert done.exit_code == 0, done.output
    printed: dict[str, object] = json.loads(done.stdout)
    return printed


def values_of(printed: dict[str, object]) -> dict[str, tuple[float, float]]:
    return {p["name"]: (p["value"], p["std"]) for p in printed["parameters"]}  # type: ignore


@pytest.mark.slow
def test_every_run_gets_its_own_offsets(given: Path, edit: Edit, command: Command) -> None:
    table = pl.read_csv(given / "validation.csv")
    robot = edit(('"offset"', '{law = "offset", per_run = true}'))
    table.with_columns(pl.col("tau2_Nm") + 4.0).write_parquet(robot.parent / "drifted.parquet")
    first = given / "identification.csv"
    printed = identify(command, robot, first, robot.parent / "drifted.parquet")
    runs: list[dict[str, float]] = printed["per_run"]  # type: ignore[assignment]
    assert [run["run"] for run in runs] == ["identification", "drifted"]
    names = [name for name in runs[0] if name != "run"]
    assert {"offset.shoulder_lift", "offset.elbow"} <= set(names)
    assert runs[1]["offset.shoulder_lift"] - runs[0]["offset.shoulder_lift"] == pytest.approx(
        4.0, abs=0.5
    )
    assert abs(runs[1]["offset.elbow"] - runs[0]["offset.elbow"]) < 0.5
    value, _ = values_of(printed)["offset.shoulder_lift"]
    assert value == pytest.approx(np.mean([run["offset.shoulder_lift"] for run in runs]))
    page = (robot.parent / "out" / "report.html").read_text()
    assert '<section id="per-run"' in page and "Parameters per run" in page
    model = steelyard.load_model(robot.parent / "out")
    assert [own.run for own in model.estimate.per_run] == ["identification", "drifted"]
    again = command("validate", robot.parent / "out", given / "validation.csv", "--json")
    assert again.exit_code == 0, again.output


@pytest.mark.slow
def test_logs_that_are_called_alike_stay_apart(given: Path, edit: Edit, command: Command) -> None:
    robot = edit(('"offset"', '{law = "offset", per_run = true}'))
    logs = [robot.parent / folder / "log.csv" for folder in ("monday", "tuesday")]
    for path, name in zip(logs, ("identification", "validation"), strict=True):
        path.parent.mkdir()
        (path.parent / path.name).write_bytes((given / f"{name}.csv").read_bytes())
    cut = f"{logs[0]}@1:4", f"{logs[0]}@4.5:6", f"{logs[1]}"
    assert [run.name for run in load_runs(robot, cut)] == ["log@1:4", "log@4.5:6", "log"]
    printed = identify(command, robot, *logs, "--method", "OLS")
    names = [run["run"] for run in printed["per_run"]]  # type: ignore[attr-defined]
    assert names == ["monday/log", "tuesday/log"]


TRANSMISSION = f"""[robot.transmission]
ratios = {np.diag(RATIOS).tolist()}
coupling = [{{motor = "motor_3", joint = "shoulder_lift", ratio = 40.0}}]

[model]
"""
MOTORS = (
    ("[model]\n", TRANSMISSION),
    ('time = "time_s"\n', f'time = "time_s"\ncoordinates = "motor"\n'
     f"position_offset = {OFFSET.tolist()}\n"),
    ('kind = "joint_torque"\n', 'kind = "motor_torque"\nside = "motor"\n'),
)  # fmt: skip


@pytest.mark.slow
def test_a_log_of_coupled_motors_identifies_the_same(
    given: Path, edit: Edit, identified: Path, command: Command
) -> None:
    """The same run, once as joints and once as motors, by matrices worked out here."""
    table = pl.read_csv(given / "identification.csv")
    columns = [f"{kind.format(k + 1)}" for kind in ("q{}_rad", "dq{}_rad_s", "tau{}_Nm")
               for k in range(N)]  # fmt: skip
    logged = table.select(columns).to_numpy()
    q, dq, tau = logged[:, :N], logged[:, N : 2 * N], logged[:, 2 * N :]
    motors = np.hstack([(q - OFFSET) @ RATIOS.T, dq @ RATIOS.T, tau @ np.linalg.inv(RATIOS)])
    robot = edit(*MOTORS)
    log = robot.parent / "identification.csv"
    table.with_columns(
        *(pl.Series(name, column) for name, column in zip(columns, motors.T, strict=True))
    ).write_csv(log)
    found = values_of(identify(command, robot, log))
    wanted = steelyard.load_model(identified).estimate
    assert list(found) == list(wanted.parameters.names)
    for name, value, std in zip(wanted.parameters.names, wanted.parameters.values, wanted.std,
                                strict=True):  # fmt: skip
        assert found[name][0] == pytest.approx(value, abs=1e-4 * std + 1e-9), name
        assert found[name][1] == pytest.approx(std, rel=1e-5)
    signals = steelyard.load_model(robot.parent / "out").signals
    assert signals.position_map is not None and signals.effort_map is not None
    np.testing.assert_allclose(signals.position_map @ RATIOS, np.eye(N), atol=1e-12)
    np.testing.assert_allclose(signals.effort_map, RATIOS.T)


def test_behind_the_gears_no_rotor_is_felt(edit: Edit) -> None:
    kind = ('kind = "joint_torque"', 'kind = "link_torque"')
    listed = '["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]'
    usual = model_with_open_friction(load_robot(edit((f"[model]\nterms = {listed}\n", ""), kind)))
    assert not any(isinstance(term, RotorInertia) for term in usual.terms)
    assert {term.law for term in usual.terms} >= {"rigid_body", "coulomb", "viscous"}
    usual = model_with_open_friction(load_robot(edit((f"[model]\nterms = {listed}\n", ""))))
    assert any(isinstance(term, RotorInertia) for term in usual.terms)
    with pytest.raises(ModelError, match="'rotor_inertia' acts on the motors' side") as caught:
        model_with_open_friction(load_robot(edit(kind)))
    assert "terms[2]" in caught.value.where and "leave it out" in caught.value.fix


def test_behind_the_gears_nothing_of_motors_is_felt(edit: Edit) -> None:
    terms = '"rigid_body", {law = "viscous", motors = ["motor_3"]}'
    gears = ("[model]\n", TRANSMISSION)
    wanted = ('"rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"', terms)
    with pytest.raises(ModelError, match="'viscous' acts on the motors' side") as caught:
        model_with_open_friction(
            load_robot(edit(gears, wanted, ('"joint_torque"', '"link_torque"')))
        )
    assert "terms[2]" in caught.value.where and "joint_torque" in caught.value.fix
    assert len(model_with_open_friction(load_robot(edit(gears, wanted))).terms) == 2


def test_friction_to_be_chosen_is_left_out(edit: Edit) -> None:
    listed = 'terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]\n'
    model = model_with_open_friction(load_robot(edit((listed, 'friction = "auto"\n'))))
    assert {term.law for term in model.terms} == {"rigid_body", "rotor_inertia", "offset"}


def test_compensated_gravity_is_not_modelled(edit: Edit) -> None:
    loaded = load_robot(edit(('"joint_torque"', '"gravity_compensated_torque"')))
    assert np.array_equal(loaded.robot.gravity, np.zeros(3))
    assert loaded.notes[-1] == "efforts are gravity compensated: the model has none either"
    plain = load_robot(edit())
    assert np.array_equal(plain.robot.gravity, [0.0, 0.0, -9.81])
    still = steelyard.Motion(np.arange(3.0), *np.random.default_rng(0).normal(size=(1, 3, N)),
                             np.zeros((3, N)), np.zeros((3, N)))  # fmt: skip
    prior = model_with_open_friction(loaded).prior
    assert prior is not None and np.all(prior.torque(still) == 0.0)


CURRENT = (
    ('"tau{}_Nm"', '"i{}_A"'),
    ('kind = "joint_torque"\nunit = "Nm"\n',
     'kind = "motor_current"\nunit = "A"\ngain = "identify"\n'),
)  # fmt: skip
MASS = 3.0


def simulated(command: Command, robot: Path, name: str, *options: object) -> Path:
    folder = robot.parent / name
    done = command("simulate", robot, "--seed", "4", "--period", "6", *options, "-o", folder)
    assert done.exit_code == 0, done.output
    (folder / "log.csv").rename(robot.parent / f"{name}.csv")
    return robot.parent / f"{name}.csv"


@pytest.mark.slow
def test_gains_of_drives_from_a_loaded_run(edit: Edit, command: Command) -> None:
    robot = edit(*CURRENT)
    bare = simulated(command, robot, "bare")
    carried = simulated(command, robot, "carried", "--payload-mass", MASS)
    options = ("--loaded", carried, "--payload-mass", MASS)
    printed = identify(command, robot, bare, *options)
    truth = json.loads((robot.parent / "bare" / "truth.json").read_text())["drive_gains"]
    gains: dict[str, list[float]] = printed["gains"]  # type: ignore[assignment]
    assert gains["joints"] == list(truth) and gains["known"] == [False] * N  # type: ignore
    error = np.abs(np.array(gains["gains"]) - list(truth.values()))
    assert np.all(error < 1.6 * np.array(gains["half_width"]))
    assert np.sum(error < np.array(gains["half_width"])) >= N - 1
    assert np.all(np.array(gains["half_width"])[:3] < 0.15 * np.array(gains["gains"])[:3])
    assert any(note.startswith("drive gains identified: ") for note in printed["notes"])  # type: ignore
    model = steelyard.load_model(robot.parent / "out")
    np.testing.assert_array_equal(model.signals.gains, gains["gains"])
    assert not any(model.signals.unknown_gains)
    assert '<section id="drives"' in (robot.parent / "out" / "report.html").read_text()


def with_currents(given: Path, folder: Path) -> Path:
    names = {f"tau{k}_Nm": f"i{k}_A" for k in range(1, N + 1)}
    path = folder / "current.parquet"
    pl.read_csv(given / "identification.csv").rename(names).write_parquet(path)
    return path


@pytest.mark.parametrize(
    ("loaded", "mass", "words"),
    [
        (False, None, ("nothing determines the scale", "a loaded run with the payload's mass")),
        (True, None, ("nothing determines the scale", "the payload's mass")),
        (False, 2.0, ("needs runs with and without it; there is none with", "give a run with")),
    ],
)
def test_gains_need_a_loaded_log_and_its_mass(
    loaded: bool, mass: float | None, words: tuple[str, ...],
    given: Path, edit: Edit, command: Command,
) -> None:  # fmt: skip
    robot = edit(*CURRENT)
    log = with_currents(given, robot.parent)
    options: list[object] = ["--loaded", f"{log}@3:6"] if loaded else []
    options += [] if mass is None else ["--payload-mass", mass]
    done = command("identify", robot, f"{log}@0:3" if loaded else log, *options,
                   "-o", robot.parent / "out")  # fmt: skip
    assert done.exit_code == 2 and not (robot.parent / "out").exists()
    assert all(word in " ".join(done.stderr.split()) for word in words), done.stderr


def test_loaded_logs_are_for_unknown_gains(given: Path, edit: Edit, command: Command) -> None:
    robot, log = edit(), given / "identification.csv"
    options = ("--loaded", given / "validation.csv", "--payload-mass", 2.0)
    done = command("identify", robot, log, *options, "-o", robot.parent / "out")
    assert done.exit_code == 2 and not (robot.parent / "out").exists()
    assert "no drive gain is to be identified" in done.stderr and "--loaded" in done.stderr
    assert "steelyard payload MODEL LOG" in " ".join(done.stderr.split())


@pytest.mark.parametrize("option", [("--payload-mass", 2.0), ("--payload-frame", "tool")])
def test_a_payload_is_for_unknown_gains(
    option: tuple[str, object], given: Path, edit: Edit, command: Command
) -> None:
    robot, log = edit(), given / "identification.csv"
    done = command("identify", robot, log, *option, "-o", robot.parent / "out")
    assert done.exit_code == 2 and not (robot.parent / "out").exists()
    assert "a payload is given, but no drive gain is to be identified" in done.stderr
    assert "--payload-mass, --payload-frame" in done.stderr

"""`steelyard feedforward`, `steelyard track`, and control in `steelyard simulate`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import ROBOT
from cli.river_files import edited
from steelyard.base.files import write_json
from steelyard.estimate.estimate import KnownScales
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.export.code.export_code import origin_of
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.robot.file.robot_file import load_robot
from steelyard.uses.control.feedforward import feedforward, remarks_on_torques

SHORT = ("simulate", ROBOT, "--period", "1.0")


@pytest.fixture(scope="module")
def motion(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short motion of the demo arm."""
    folder = tmp_path_factory.mktemp("motion") / "run"
    made = steelyard.simulate(given / "demo_arm.toml", folder, period=1.0, seed=5)
    return made.files.trajectory


def test_feedforward_writes_the_torques_of_the_model(
    command: Command, identified: Path, motion: Path, tmp_path: Path
) -> None:
    out = tmp_path / "torques.csv"
    done = command("feedforward", identified, motion, "--rate", "100", "-o", out, "--json")
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    model = steelyard.load_model(identified)
    table = pl.read_csv(out)
    assert table.columns[0] == "time_s" and len(table) == told["samples"] == 101
    parts = [
        table.select([f"{what}_{name}" for name in model.joints]).to_numpy()
        for what in ("q", "dq", "ddq", "tau")
    ]
    samples = steelyard.Motion(table["time_s"].to_numpy(), *parts[:3])
    moving = np.abs(parts[1]).min(axis=1) > 0.02
    np.testing.assert_allclose(parts[3][moving], model.torque(samples)[moving], rtol=1e-6)
    assert [joint["peak"] for joint in told["joints"]] == pytest.approx(
        np.abs(parts[3]).max(axis=0).tolist()
    )
    done = command("feedforward", identified, motion, "-o", tmp_path / "t.parquet")
    assert done.exit_code == 0 and model.joints[0] in done.stdout and "251 rows" in done.stdout
    assert not set("┏┃━│") & set(done.stdout)
    assert pl.read_parquet(tmp_path / "t.parquet").columns == table.columns


def test_joints_of_a_motion_are_matched_by_name(
    identified: Path, motion: Path, tmp_path: Path
) -> None:
    values = json.loads(motion.read_text())
    trajectory = read_motion(motion, steelyard.load_model(identified).model.robot)
    expected = feedforward(identified, motion)
    t = expected.motion.t
    table = {"time_s": t.tolist(), "q": trajectory.sample(t).q[:, ::-1].tolist()}
    turned = {"joints": values["joints"][::-1], "kind": "sampled", **table}
    write_json(tmp_path / "turned.json", turned)
    found = feedforward(identified, tmp_path / "turned.json")
    assert [joint.name for joint in found.joints] == values["joints"]
    np.testing.assert_allclose(found.motion.q, expected.motion.q, atol=1e-9)
    rows = {f"q_{n}": expected.motion.q[:, k] for k, n in enumerate(values["joints"])}
    order = ["time_s", *reversed(list(rows))]
    pl.DataFrame({"time_s": t, **rows}).select(order).write_csv(tmp_path / "turned.csv")
    found = feedforward(identified, tmp_path / "turned.csv")
    np.testing.assert_allclose(found.motion.q, expected.motion.q, atol=1e-9)


def test_motions_that_lack_joints_are_refused(
    command: Command, identified: Path, motion: Path, tmp_path: Path
) -> None:
    robot = steelyard.load_model(identified).model.robot
    sampled = read_motion(motion, robot).sample(np.linspace(0.0, 1.0, 50))
    table = {"kind": "sampled", "time_s": sampled.t.tolist(), "q": sampled.q[:, :-1].tolist()}
    for joints, words in (
        (list(robot.joint_names[:-1]), f"the motion has no joint '{robot.joint_names[-1]}'"),
        (None, "the motion has 2 joints without names, the model 3"),
    ):
        named = table if joints is None else {"joints": joints, **table}
        write_json(tmp_path / "less.json", named)
        done = command("feedforward", identified, tmp_path / "less.json")
        assert done.exit_code == 2 and words in done.stderr
    columns = {f"q_{n}": sampled.q[:, k] for k, n in enumerate(robot.joint_names[1:], start=1)}
    pl.DataFrame({"time_s": sampled.t, **columns}).write_csv(tmp_path / "less.csv")
    done = command("feedforward", identified, tmp_path / "less.csv")
    assert done.exit_code == 2 and f"no column for joint '{robot.joint_names[0]}'" in done.stderr
    frame = pl.DataFrame({"time_ms": sampled.t})
    frame.write_csv(tmp_path / "ms.csv")
    done = command("feedforward", identified, tmp_path / "ms.csv")
    assert done.exit_code == 2 and "convert other units" in " ".join(done.stderr.split())
    (tmp_path / "kept.csv").write_text("kept")
    done = command("feedforward", identified, motion, "-o", tmp_path / "kept.csv")
    assert done.exit_code == 2 and "the file exists already" in done.stderr
    assert (tmp_path / "kept.csv").read_text() == "kept"
    done = command("feedforward", identified, tmp_path / "none.json")
    assert done.exit_code == 2 and "cannot be read" in done.stderr
    with pytest.raises(steelyard.SteelyardError, match="together with a file"):
        feedforward(identified, motion, joints=["a"])


def test_torques_beyond_the_limits_are_reported(
    command: Command, identified: Path, motion: Path, tmp_path: Path
) -> None:
    plain = feedforward(identified, motion)
    assert not plain.warnings and "!" not in str(plain)
    noisy = replace(plain.motion, ddq=plain.motion.ddq + 1e4)
    found = feedforward(identified, noisy)
    *joints, advice = found.warnings
    beyond = [c for k, c in enumerate(found.joints) if found.peaks[k] > c.limits.effort]
    assert beyond and len(joints) == len(beyond)
    for words, joint in zip(joints, beyond, strict=True):
        assert words.startswith(f"{joint.name}: ")
        assert f"is beyond its limit of {joint.limits.effort:.4g} (acceleration 1e+04; " in words
    assert advice.startswith("do not command these torques") and f"! {advice}" in str(found)
    t = np.arange(0.0, 2.0, 0.004)
    steps = {f"q_{c.name}": 0.05 * (np.arange(len(t)) % 2) for c in found.joints}
    pl.DataFrame({"time_s": t, **steps}).write_csv(tmp_path / "noisy.csv")
    done = command("feedforward", identified, tmp_path / "noisy.csv", "-o", tmp_path / "n.csv")
    assert done.exit_code == 0 and f"! {beyond[0].name}: " in done.stdout


def test_measured_positions_and_degrees_are_reported(
    identified: Path, motion: Path, tmp_path: Path
) -> None:
    planned = feedforward(identified, motion, rate=100.0)
    names = [joint.name for joint in planned.joints]
    rng = np.random.default_rng(0)

    def warnings(q: np.ndarray) -> tuple[str, ...]:
        columns = {f"q_{n}": column for n, column in zip(names, q.T, strict=True)}
        table = tmp_path / "table.csv"
        pl.DataFrame({"time_s": planned.motion.t, **columns}).write_csv(table)
        return feedforward(identified, table).warnings

    assert warnings(planned.motion.q) == ()
    noise = np.zeros(planned.motion.q.shape)
    noise[:, 1] = 3e-4 * rng.standard_normal(len(noise))
    *_, words = warnings(planned.motion.q + noise)
    assert words.startswith("do not command these torques: accelerations of")
    assert names[1] in words and names[0] not in words
    (words,) = warnings(np.full(planned.motion.q.shape, 90.0))
    assert "far beyond its limits" in words and words.endswith("convert degrees")


def test_a_part_of_a_motion_needs_the_same_torques(
    identified: Path, motion: Path, tmp_path: Path
) -> None:
    whole = feedforward(identified, motion)
    part = slice(60, 190)
    moving = np.abs(whole.motion.dq[[60, 189]])
    assert moving.min(axis=0).max() > 0.1
    positions = whole.motion.q[part].T
    columns = {f"q_{c.name}": q for c, q in zip(whole.joints, positions, strict=True)}
    pl.DataFrame({"time_s": whole.motion.t[part], **columns}).write_csv(tmp_path / "part.csv")
    found = feedforward(identified, tmp_path / "part.csv")
    np.testing.assert_allclose(found.motion.t, whole.motion.t[part], atol=1e-12)
    error = np.abs(found.torque - whole.torque[part]).max(axis=0)
    assert (error < 0.01 * whole.peaks).all()


def changed(identified: Path, folder: Path, **signals: object) -> Path:
    """The model with other signals."""
    data = json.loads((identified / "model.json").read_text())
    data["signals"] |= signals
    folder.mkdir()
    write_json(folder / "model.json", data)
    return folder


def test_efforts_that_are_no_torques_are_refused(
    command: Command, identified: Path, motion: Path, tmp_path: Path
) -> None:
    unknown = changed(identified, tmp_path / "unknown", unknown_gains=[False] * 2 + [True])
    amperes = changed(identified, tmp_path / "amperes", effort_units=["A"] * 3)
    for model in (unknown, amperes):
        for words in (
            ("feedforward", model, motion),
            ("track", ROBOT, motion, "--model", model),
            (*SHORT, "--model", model, "-o", tmp_path / "o"),
        ):
            done = command(*words)
            assert done.exit_code == 2 and "the model's efforts are no torques" in done.stderr
    assert not (tmp_path / "o").exists()


def test_gravity_compensated_efforts_are_noted_or_refused(
    command: Command, identified: Path, motion: Path, tmp_path: Path
) -> None:
    model = changed(identified, tmp_path / "light", effort_kind="gravity_compensated_torque")
    data = json.loads((model / "model.json").read_text())
    data["model"]["robot"]["gravity"] = [0.0, 0.0, 0.0]
    write_json(model / "model.json", data)
    done = command("feedforward", model, motion)
    assert done.exit_code == 0 and "torques are without gravity" in done.stdout
    done = command("track", ROBOT, motion, "--model", model)
    assert done.exit_code == 2 and "identified from gravity-compensated efforts" in done.stderr


def test_torques_behind_the_gears_are_noted(identified: Path, motion: Path, tmp_path: Path) -> None:
    model = changed(identified, tmp_path / "behind", effort_kind="link_torque")
    found = feedforward(model, motion)
    (note,) = found.notes
    first, *joints, last = str(found).splitlines()
    assert first == f"{len(found.motion)} samples" and last == f"note: {note}"
    assert [line.split()[0] for line in joints] == [joint.name for joint in found.joints]
    assert joints[0].endswith(f"RMS {found.rms[0]:.4g}, largest {found.peaks[0]:.4g} Nm")
    assert repr(found) == f"FeedforwardTorques({first}, {len(joints)} joints)"
    assert "on the link side" in note and not feedforward(identified, motion).notes


def test_torques_are_in_the_unit_of_the_log_on_request(
    command: Command, identified: Path, motion: Path, tmp_path: Path
) -> None:
    model = steelyard.load_model(identified)
    values = np.linspace(0.8, 1.2, model.robot.n)
    scaled = replace(
        model, effort_scales=KnownScales(model.joints, values, 1e-4 * np.eye(model.robot.n))
    )
    plain, found = feedforward(scaled, motion), feedforward(scaled, motion, as_logged=True)
    np.testing.assert_allclose(found.torque, plain.torque * values, rtol=1e-12)
    (note,) = plain.notes
    assert f"logged efforts are {model.joints[0]} 0.80" in note and not found.notes
    assert f"{model.joints[-1]} 1.20 times as large" in origin_of(scaled)[-1]
    folder = tmp_path / "scaled"
    folder.mkdir()
    (folder / "model.json").write_text(scaled.text())
    for option, factor in (((), 1.0), (("--as-logged",), values)):
        out = tmp_path / f"torques{len(option)}.csv"
        done = command("feedforward", folder, motion, "-o", out, *option)
        assert done.exit_code == 0, done.stderr
        table = pl.read_csv(out)
        written = np.column_stack([table[f"tau_{joint}"] for joint in model.joints])
        np.testing.assert_allclose(written, plain.torque * factor, rtol=1e-9, atol=1e-9)


def test_friction_with_memory_is_noted(identified: Path) -> None:
    model = steelyard.load_model(identified)
    terms = (*model.model.terms, Dahl(length=1e-3))
    (note,) = remarks_on_torques(replace(model, model=steelyard.Model(model.robot, terms)))
    assert "is zero at first from rest" in note


@pytest.mark.slow
def test_a_random_true_robot_is_stated(command: Command, motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "tracked"
    done = command("track", ROBOT, motion, "-o", out)
    assert done.exit_code == 0, done.stderr
    words = "random true parameters near the nominal ones; give the true ones with --truth"
    assert words in " ".join(done.stdout.split())
    told = json.loads((out / "tracking.json").read_text())
    assert told["random_truth"] and words in told["headline"]


@pytest.mark.slow
def test_track_compares_with_and_without_the_model(
    command: Command, given: Path, identified: Path, motion: Path, tmp_path: Path
) -> None:
    truth = given / "truth.json"
    out = tmp_path / "tracked"
    words = ("track", ROBOT, motion, "--model", identified, "--truth", truth)
    done = command(*words, "--friction-drift", "1.2", "-o", out)
    assert done.exit_code == 0, done.stderr
    assert "cascade + feedforward" in done.stdout and str(out / "tracking.html") in done.stdout
    told = json.loads((out / "tracking.json").read_text())
    bare, model = told["controllers"]
    assert bare["name"] == "cascade" and told["settings"]["factor on true friction"] == "1.2"
    assert np.mean([joint["ratio"] for joint in model["joints"]]) < 0.6
    assert model["tool"]["rms"] < 0.6 * bare["tool"]["rms"] and bare["tool"]["frame"] == "tool"
    assert "Path of the tool" in (out / "tracking.html").read_text()
    assert "random" not in told["headline"] and not told["random_truth"]
    done = command(*words, "--control", "pd,kp=400", "--tool", "forearm", "--lag", "0",
                   "--json", "-o", tmp_path / "second")  # fmt: skip
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["controllers"][0]["tool"]["frame"] == "forearm" and len(told["controllers"]) == 2
    assert told["settings"]["lag of the drives' torque"] == "0 ms"


def test_a_model_of_other_joints_is_refused(
    command: Command, identified: Path, motion: Path, tmp_path: Path
) -> None:
    data = json.loads((identified / "model.json").read_text())
    data["model"]["robot"]["coordinates"][0]["name"] = "hip"
    (tmp_path / "other").mkdir()
    write_json(tmp_path / "other" / "model.json", data)
    done = command("track", ROBOT, motion, "--model", tmp_path / "other")
    assert done.exit_code == 2 and "the model has the joints hip" in done.stderr


@pytest.mark.slow
def test_simulate_has_controllers_a_truth_a_rate_and_a_wrench(
    command: Command, given: Path, identified: Path, motion: Path, tmp_path: Path
) -> None:
    push = tmp_path / "push.csv"
    push.write_text("time_s,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm\n1.2,5,0,-10,0,0,1\n1.4,0,0,0,0,0,0\n")
    words = (
        "simulate", ROBOT, "--motion", motion, "--truth", given / "truth.json", "--rate", "500",
        "--control", "cascade", "--model", identified, "--wrench", push, "--wrench-axes", "frame",
        "--wrench-frame", "tool", "--noise", "0",
    )  # fmt: skip
    done = command(*words, "-o", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert str(given / "truth.json") in done.stdout
    assert (tmp_path / "run" / "truth.json").read_text() == (given / "truth.json").read_text()
    log = pl.read_csv(tmp_path / "run" / "log.csv")
    np.testing.assert_allclose(np.diff(log["time_s"]), 2e-3, atol=1e-9)
    names = [f"{what}{k}_{unit}" for what, unit in (("q_cmd", "rad"), ("dq_cmd", "rad_s"),
             ("tau_cmd", "Nm")) for k in range(1, 4)]  # fmt: skip
    assert log.columns[-15:] == [*names, "fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"]
    pushed = (log["time_s"] >= 1.2 - 1e-6) & (log["time_s"] < 1.4 - 1e-6)
    np.testing.assert_allclose(log["fz_N"], np.where(pushed, -10.0, 0.0), atol=1e-9)
    robot = load_robot(given / "demo_arm.toml").robot
    goal = read_motion(motion, robot).sample(np.clip(log["time_s"] - 1.0, 0.0, 1.0))
    np.testing.assert_allclose(log.select(names[:3]).to_numpy(), goal.q, atol=1e-6)
    assert np.abs(log.select([f"q{k}_rad" for k in range(1, 4)]).to_numpy() - goal.q).max() < 0.02


@pytest.mark.slow
def test_a_log_with_commands_is_read_as_any_other(command: Command, tmp_path: Path) -> None:
    done = command(*SHORT, "--control", "pd", "-o", tmp_path / "commanded")
    assert done.exit_code == 0, done.stderr
    log, file = tmp_path / "commanded" / "log.csv", tmp_path / "arm.toml"
    command("init", "../given/demo_arm.urdf", log, "--no-input", "-o", file)
    signals = load_robot(file).signals
    assert signals is not None
    assert (signals.position[0], signals.effort[0]) == ("q1_rad", "tau1_Nm")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--truth", "none.json"), "the truth cannot be read"),
        (("--truth", ROBOT), "the file is no truth"),
        (("--rate", "1300"), "a log cannot have 1300 rows a second"),
        (("--control", "bang"), "there is no controller 'bang'"),
        (("--control", "computed_torque"), "computes with a model"),
        (("--wrench-frame", "tool"), "add --wrench FILE"),
        (("--wrench", "none.csv"), "none.csv"),
        (("--friction-drift", "inf"), "--friction-drift"),
        (("--noise", "inf"), "--noise"),
    ],
)
def test_unusable_options_of_simulate(
    command: Command, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    done = command(*SHORT, *options, "-o", tmp_path / "o")
    assert done.exit_code == 2 and words in done.stderr
    assert not (tmp_path / "o").exists()


@pytest.mark.slow
def test_a_truth_keeps_its_drive_gains(given: Path, command: Command, tmp_path: Path) -> None:
    joint = 'kind = "joint_torque"\nunit = "Nm"\n'
    current = 'kind = "motor_current"\nunit = "A"\ngain = "identify"\n'
    robot = edited(given, tmp_path, ('"tau{}_Nm"', '"i{}_A"'), (joint, current))
    first, again = tmp_path / "first", tmp_path / "again"
    assert command("simulate", robot, "--period", "1", "--seed", "3", "-o", first).exit_code == 0
    truth = first / "truth.json"
    words = ("simulate", robot, "--period", "1", "--seed", "4", "--truth", truth, "-o", again)
    done = command(*words)
    assert done.exit_code == 0, done.stderr
    told = [json.loads((folder / "truth.json").read_text()) for folder in (first, again)]
    assert told[0]["drive_gains"] and told[0] == told[1]


@pytest.mark.slow
def test_a_rate_that_the_robot_file_contradicts_is_refused(
    given: Path, command: Command, tmp_path: Path
) -> None:
    robot = edited(given, tmp_path, ('time = "time_s"', "rate = 200.0"))
    words = ("simulate", robot, "--period", "1", "--rate")
    done = command(*words, "250", "-o", tmp_path / "o")
    assert done.exit_code == 2 and "the robot file declares 200" in done.stderr
    done = command(*words, "200", "-o", tmp_path / "o")
    assert done.exit_code == 0, done.stderr


@pytest.mark.slow
def test_friction_drift_is_in_the_truth(command: Command, tmp_path: Path) -> None:
    found = {}
    for factor in ("1", "1.5"):
        done = command(*SHORT, "--friction-drift", factor, "-o", tmp_path / factor)
        assert done.exit_code == 0
        truth = json.loads((tmp_path / factor / "truth.json").read_text())["parameters"]
        found[factor] = {name: one["value"] for name, one in truth.items()}
    for name, value in found["1"].items():
        factor = 1.5 if name.split(".")[0] in ("coulomb", "viscous") else 1.0
        assert found["1.5"][name] == pytest.approx(factor * value)

"""Actuators of an arm that MuJoCo simulates: found again, predicted, written, read, refused."""

import ast
import json
import re
import sys
import types
from dataclasses import replace
from pathlib import Path
from shutil import copyfile
from typing import Any

import mujoco
import numpy as np
import polars as pl
import pytest
from proofs.support.servo_arm import (
    BENCH_FILE,
    BENCH_URDF,
    ROBOT_FILE,
    URDF,
    Servos,
    log,
    made,
    targets,
)
from typer.testing import CliRunner

import steelyard
from browser import Tab
from report.pages import wrong_on_screen
from steelyard.actuators.actuator_model import ActuatorModel
from steelyard.actuators.actuator_parameters import Free
from steelyard.actuators.actuators_page import ActuatorIdentification, replay_section
from steelyard.actuators.rollout import rollouts
from steelyard.actuators.target_runs import TargetRun, windows_of
from steelyard.base.errors import LogError, ModelError
from steelyard.cli.app import app
from steelyard.export.model_files.actuators_mjcf import actuators_mjcf
from steelyard.export.model_files.actuators_python import actuators_python
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import sticks, tips

TRUE = Servos()
FIXED = '[actuator]\nlaw = "position_pd"\n'  # no choice of the law: quicker


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("servos")
    made(place, TRUE)
    (place / "fixed.toml").write_text(ROBOT_FILE + FIXED)
    return place


@pytest.fixture(scope="module")
def found(folder: Path) -> ActuatorIdentification:
    result = steelyard.identify_actuators(
        folder / "servos.toml", folder / "servo_fit.csv", folder / "servo_other.csv"
    )
    result.save(folder / "model")
    return result


def test_parameters_are_those_of_the_simulated_servos(found: ActuatorIdentification) -> None:
    true = vars(TRUE)
    values = {(p.name, p.joint): p for p in found.parameters}
    for name in ("stiffness", "damping", "coulomb", "armature"):
        for j, joint in enumerate(("shoulder", "elbow")):
            one = values[name, joint]
            assert one.status == "identified"
            assert one.value == pytest.approx(true[name][j], rel=0.04), one
            assert one.interval is not None
            assert one.interval[0] < one.value < one.interval[1]
    assert values["delay", "all"].value == pytest.approx(TRUE.delay, abs=3e-4)
    assert values["zero", "elbow"].value == pytest.approx(0.0, abs=0.03)
    assert values["dead_band", "elbow"].status == "not in the law"


def test_unseen_motion_is_predicted_to_the_noise_of_the_encoder(
    found: ActuatorIdentification,
) -> None:
    (unseen,) = found.validation
    assert unseen.rms.max() < 1.5e-3
    assert unseen.target_rms.min() > 0.02
    assert found.verdict.level == "good"
    assert found.verdict.unseen
    assert [one.after for one in unseen.drift] == [0.1, 0.5, 2.0]
    assert unseen.tool < 1e-3 < unseen.target_tool


def test_a_part_that_the_servos_lack_is_not_in_the_law(found: ActuatorIdentification) -> None:
    tried = {rung.tried: rung.kept for rung in found.law}
    assert tried["- coulomb"] is tried["- delay"] is False
    assert tried["+ torque_limit"] is tried["+ dead_band"] is False


def test_the_model_is_read_again_as_it_was(found: ActuatorIdentification, folder: Path) -> None:
    again = steelyard.load_actuators(folder / "model")
    assert again.to_dict() == found.model.to_dict()
    scored = steelyard.validate_actuators(again, folder / "servo_other.csv")
    np.testing.assert_allclose(scored.validation[0].rms, found.validation[0].rms, rtol=1e-9)
    assert "on motion that was not fitted" in str(scored)
    fitted = steelyard.validate_actuators(again, folder / "servo_fit.csv")
    assert fitted.verdict.level == "none"
    assert "does not validate" in str(fitted)


def test_report_and_text_say_what_was_found(found: ActuatorIdentification, folder: Path) -> None:
    page = (folder / "model" / "report.html").read_text("utf-8")
    assert "Measured and predicted motion" in page and "stiffness" in page
    text = str(found)
    assert "GOOD" in text and "masses in the model file" in text and "shoulder" in text
    json.dumps(found.to_dict(), allow_nan=False)


def test_exported_mjcf_moves_as_the_rollout(found: ActuatorIdentification) -> None:
    model = found.model
    text = actuators_mjcf(model).text
    arm = mujoco.MjModel.from_xml_string(text)
    step = arm.opt.timestep
    t, target = targets(10.0, seed=11)
    (window,) = windows_of([TargetRun("log", t, target, np.tile(target[0], (len(t), 1)))], None)
    (ours,) = rollouts(model.arm, model.values, [window], (), 2e-4)
    data, every = mujoco.MjData(arm), round(0.02 / step)
    v = model.values
    ctrl = v.signs * (target + v["offset"]) + v["zero"]
    data.qpos[:] = v.signs * target[0] + v["zero"]
    for j in range(2):
        held = np.full((arm.actuator_history[j, 0], 1), ctrl[0, j])
        mujoco.mj_initCtrlHistory(arm, data, j, None, held)
    times, worst = np.arange(round(10.0 / step)) * step, 0.0
    rows = np.searchsorted(t, times + 1e-9, side="right") - 1
    for k, row in enumerate(rows):
        if k % every == 0:
            q = v.signs * (data.qpos - v["zero"])
            worst = max(worst, float(np.abs(q - ours.q[k // every]).max()))
        data.ctrl[:] = ctrl[row]
        mujoco.mj_step(arm, data)
    assert worst < 1e-3
    assert "95 % intervals" in text and "ctrl = +1" in text and "actuatorfrcrange" not in text


@pytest.mark.parametrize("framework", ["isaaclab", "mjlab"])
def test_exported_configurations_hold_the_values(
    found: ActuatorIdentification,
    folder: Path,
    tmp_path: Path,
    framework: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = tmp_path / "arm.py"
    arguments = ["export", str(folder / "model"), "--to", framework, "-o", str(file)]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    module = {"isaaclab": "isaaclab.actuators", "mjlab": "mjlab.actuator"}[framework]
    stub, code = types.ModuleType(module), dict[str, Any]()
    stub.DelayedPDActuatorCfg = stub.BuiltinPositionActuatorCfg = dict  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, framework, types.ModuleType(framework))
    monkeypatch.setitem(sys.modules, module, stub)
    exec(file.read_text("utf-8"), code)
    made = code["actuators"](0.005)
    values, listed = found.model.values, list(made.values() if framework == "isaaclab" else made)
    dry, late = {
        "isaaclab": ("dynamic_friction", "max_delay"),
        "mjlab": ("frictionloss", "delay_max_lag"),
    }[framework]
    for j, one in enumerate(listed):
        for name in ("stiffness", "damping", "armature"):
            assert one[name] == values[name][j]
        assert one[dry] == values["coulomb"][j]
        assert one["effort_limit"] is None
        assert one[late] == round(values["delay"][j] / 0.005)
    assert len(listed) == 2 and "95 % intervals" in file.read_text("utf-8")


def test_exports_of_an_arm_with_a_finger_that_follows(
    found: ActuatorIdentification, tmp_path: Path
) -> None:
    finger = """<link name="finger"><inertial><mass value="0.01"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="follower" type="revolute"><parent link="lower"/><child link="finger"/>
    <axis xyz="0 1 0"/><mimic joint="elbow" multiplier="0.5"/></joint></robot>"""
    (tmp_path / "arm.urdf").write_text(URDF.replace("</robot>", finger))
    values = found.model.values.changed(back_emf=(0.2, 0.1), damping=1e-6, stribeck=0.02)
    odd = replace(found.model, robot=load_robot(tmp_path / "arm.urdf").robot, values=values)
    made = actuators_mjcf(odd)
    arm = mujoco.MjModel.from_xml_string(made.text)
    assert arm.joint("elbow").damping == pytest.approx(0.1) and arm.nu == 2
    assert any("falls with speed" in one for one in made.unsupported)
    lacks = actuators_python(odd, "isaaclab").unsupported
    assert lacks == ("the speed over which dry friction falls (shoulder 1.00, elbow 1.00)",)
    assert f"damping={0.2 + 1e-6!r}" in actuators_python(odd, "mjlab").text


@pytest.mark.parametrize(
    ("ending", "advice"), [("xml", "_isaaclab.py"), ("urdf", "_isaaclab.py"), ("py", "")]
)
def test_configurations_are_python_files(
    found: ActuatorIdentification, folder: Path, tmp_path: Path, ending: str, advice: str
) -> None:
    file = str(tmp_path / f"arm.{ending}")
    done = CliRunner().invoke(
        app, ["export", str(folder / "model"), "--to", "isaaclab", "-o", file]
    )
    assert (done.exit_code == 0) == (advice == "") and advice in " ".join(done.output.split())


def test_parts_that_are_stated_are_in_the_law(folder: Path) -> None:
    text = (folder / "servos.toml").read_text() + (
        'position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n[actuator]\nlaw = "position_pd"\n'
        'delay = [0.012, "identify"]\nstribeck = 0.02\nstribeck_speed = [0.3, "identify"]\n'
        "back_emf = [0.1, 0.05]\n"
    )
    (folder / "parts.toml").write_text(text)
    result = steelyard.identify_actuators(folder / "parts.toml", folder / "servo_fit.csv")
    values = {(p.name, p.joint): p for p in result.parameters}
    assert values["delay", "shoulder"].value == 0.012
    assert values["delay", "elbow"].value == pytest.approx(0.012, abs=1e-3)
    assert values["delay", "elbow"].interval is not None
    assert values["stribeck", "elbow"].value == 0.02
    assert values["stribeck_speed", "shoulder"].value == 0.3
    assert values["stribeck_speed", "elbow"].interval is not None
    # back-EMF and damping are one below the torque limit: their sum is what motion shows
    assert values["back_emf", "shoulder"].value == 0.1
    assert values["damping", "shoulder"].value == pytest.approx(TRUE.damping[0] - 0.1, rel=0.1)
    assert "delay  12.0 ms of shoulder, stated" in str(result)


def test_delays_of_single_joints_have_intervals(found: ActuatorIdentification) -> None:
    model = found.model
    place = model.free.index(Free("delay", -1))
    one = replace(model, free=(*model.free[:place], Free("delay", 0), *model.free[place + 1 :]))
    delays = {p.joint: p for p in one.parameters if p.name == "delay"}
    assert delays["shoulder"].interval is not None and set(delays) == {"shoulder", "elbow"}


def test_names_of_joints_stay_text_in_configurations(found: ActuatorIdentification) -> None:
    robot = found.model.robot
    name = "a'\")\nimport os\n#"
    joints = (replace(robot.coordinates[0], name=name), robot.coordinates[1])
    odd = replace(found.model, robot=replace(robot, coordinates=joints))
    tree = ast.parse(actuators_python(odd, "mjlab").text)
    assert [ast.unparse(x) for x in tree.body if isinstance(x, ast.Import)] == ["import re"]


def test_reversed_and_shifted_columns_are_found(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    (tmp_path / "servos.toml").write_text(ROBOT_FILE + FIXED)
    for name in ("servo_fit", "servo_other"):
        table = pl.read_csv(folder / f"{name}.csv")
        pl.DataFrame(
            {
                column: -table[column] + 0.4 if column in ("q1", "target1") else table[column]
                for column in table.columns
            }
        ).write_csv(tmp_path / f"{name}.csv")
    other = steelyard.identify_actuators(
        tmp_path / "servos.toml", tmp_path / "servo_fit.csv", tmp_path / "servo_other.csv"
    )
    assert other.validation[0].rms.max() < 1.6e-3
    turned = other.model.values
    stiffness = turned["stiffness"]
    if turned.signs.tolist() == [-1.0, 1.0]:
        assert turned["zero"][0] == pytest.approx(0.4, abs=0.05)
        assert stiffness == pytest.approx(TRUE.stiffness, rel=0.1)
    else:
        assert any("not decided" in words for words in other.warnings) and other.model.open_signs


def test_what_is_stated_is_kept(folder: Path) -> None:
    text = (folder / "servos.toml").read_text() + (
        'position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n[actuator]\nlaw = "position_pd"\n'
        'stiffness = [12.0, "identify"]\ndelay = 0.012\ntorque_limit = 50.0\n'
    )
    (folder / "stated.toml").write_text(text)
    result = steelyard.identify_actuators(folder / "stated.toml", folder / "servo_fit.csv")
    values = {(p.name, p.joint): p for p in result.parameters}
    assert values["stiffness", "shoulder"].value == 12.0
    assert values["stiffness", "shoulder"].status == "stated"
    assert values["stiffness", "elbow"].value == pytest.approx(8.0, rel=0.04)
    assert values["delay", "all"].status == values["torque_limit", "elbow"].status == "stated"
    assert values["zero", "shoulder"].value == 0.0
    assert len(result.law) == 1
    assert result.verdict.level == "none" and "no log validates" in result.verdict.line


def test_a_joint_that_rests_keeps_no_limit_and_back_emf_needs_one(
    folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    more = '[actuator]\nlaw = "position_pd"\ntorque_limit = "identify"\nmass_factor = "identify"\n'
    (tmp_path / "servos.toml").write_text(ROBOT_FILE + more)
    table = pl.read_csv(folder / "servo_fit.csv")
    still = table.with_columns(q2=pl.lit(0.2), target2=pl.lit(0.2))
    still.write_csv(tmp_path / "log.csv")
    model = steelyard.identify_actuators(tmp_path / "servos.toml", tmp_path / "log.csv").model
    values = {(p.name, p.joint): p for p in model.parameters}
    for name in ("torque_limit", "mass_factor"):
        assert values[name, "elbow"].status == "not in the law"
    assert model.values["torque_limit"][1] > 1e6
    factor = values["mass_factor", "shoulder"].interval
    assert factor is not None and factor[0] < 1.0 < factor[1]
    (tmp_path / "servos.toml").write_text(ROBOT_FILE + '[actuator]\nback_emf = "identify"\n')
    with pytest.raises(ModelError, match="back-EMF and damping are one"):
        steelyard.identify_actuators(tmp_path / "servos.toml", tmp_path / "log.csv")


def test_exports_have_limits_that_contain_the_motion(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(
        URDF.replace('lower="-1.8" upper="1.8"', 'lower="-1.1" upper="1.1"')
    )
    more = 'position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n[actuator]\nlaw = "position_pd"\n'
    (tmp_path / "servos.toml").write_text(ROBOT_FILE + more)
    found = steelyard.identify_actuators(tmp_path / "servos.toml", folder / "servo_fit.csv")
    assert any("shoulder moves over" in note and "exports" in note for note in found.notes)
    q = pl.read_csv(folder / "servo_fit.csv").select("q1", "q2").to_numpy()
    arm = mujoco.MjModel.from_xml_string(actuators_mjcf(found.model).text)
    assert (arm.jnt_range[:, 0] <= q.min(axis=0)).all() and (
        arm.jnt_range[:, 1] >= q.max(axis=0)
    ).all()


def test_masses_are_identified_where_the_stiffness_is_known(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF.replace('mass value="0.2"', 'mass value="0.16"'))
    (tmp_path / "servos.toml").write_text(
        ROBOT_FILE + "position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n[actuator]\n"
        'law = "position_pd"\nstiffness = [12.0, 8.0]\nmass_factor = "identify"\n'
    )
    result = steelyard.identify_actuators(tmp_path / "servos.toml", folder / "servo_fit.csv")
    lower = next(p for p in result.parameters if (p.name, p.joint) == ("mass_factor", "elbow"))
    assert lower.interval is not None and lower.status == "identified"
    assert lower.interval[0] < 1.25 < lower.interval[1]
    assert lower.value == pytest.approx(1.25, rel=0.03)
    again = ActuatorModel.from_dict(json.loads(result.model.text()))
    arm = mujoco.MjModel.from_xml_string(actuators_mjcf(again).text)
    assert arm.body_mass[-1] == pytest.approx(0.2, rel=0.03)
    assert "factors on the masses of links" in str(result)
    comments = actuators_python(again, "isaaclab").text
    assert "masses of the links behind the joints, over those of the model file" in comments
    older = json.loads(result.model.text())
    del older["values"]["mass_factor"]
    assert (ActuatorModel.from_dict(older).values["mass_factor"] == 1.0).all()


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"target1": "target2", "target2": "target1"}, "follow the targets"),
        ({"target1": 57.3}, "times as far"),
        ({"target2": -1.0}, "against their targets"),
        ({"target1": 0.0, "target2": 0.0}, "no joint's target moves"),
        ({"time": 50.0}, "too few to show"),
    ],
    ids=["order", "degrees", "sign", "still", "slow clock"],
)
def test_targets_that_are_others_are_refused(
    folder: Path, tmp_path: Path, change: dict[str, str | float], wrong: str
) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    new = {
        name: table[by] if isinstance(by := change.get(name, 1.0), str) else table[name] * by
        for name in table.columns
    }
    pl.DataFrame(new).write_csv(tmp_path / "log.csv")
    with pytest.raises(LogError, match=wrong):
        steelyard.identify_actuators(folder / "servos.toml", tmp_path / "log.csv")


def test_rows_without_numbers_are_left_out_and_counted(folder: Path, tmp_path: Path) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    q = table["q1"].to_numpy().copy()
    q[100:110] = np.nan
    t = table["time"].to_numpy().copy()
    t[1500:] += 3.0
    pl.DataFrame({**{c: table[c] for c in table.columns}, "q1": q, "time": t}).write_csv(
        tmp_path / "log.csv"
    )
    result = steelyard.identify_actuators(folder / "fixed.toml", tmp_path / "log.csv")
    assert any("10 rows left out" in note for note in result.notes)
    assert result.fitted[0].rms.max() < 1.5e-3


def test_short_logs_and_robots_without_masses_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="32 s are needed"):
        steelyard.identify_actuators(folder / "servos.toml", f"{folder / 'servo_fit.csv'}@0:10")
    bare = URDF[: URDF.index("<inertial>")] + URDF[URDF.index("</inertial>") + 11 :]
    (tmp_path / "servos.urdf").write_text(bare)
    (tmp_path / "servos.toml").write_text(ROBOT_FILE)
    with pytest.raises(ModelError, match="no masses|mass"):
        steelyard.identify_actuators(tmp_path / "servos.toml", folder / "servo_fit.csv")


def test_a_damaged_model_is_refused(found: ActuatorIdentification, tmp_path: Path) -> None:
    data = found.model.to_dict()
    for change in (
        {"signs": [1.0, 2.0]},
        {"free": [["mass", 0]]},
        {"values": {}},
        {"covariance": [[1.0]]},
        {"covariance": (-np.eye(len(data["free"]))).tolist()},
        {"covariance": (1e6 * np.eye(len(data["free"]))).tolist()},
        *({"wider": x} for x in (-5.0, 0.0, True, "3", [2.0])),
        *({"assumed": x} for x in (["nonsense"], "elbow", [1], [["elbow"]])),
        {"step_s": 0.0},
        {"step_s": 1e-12},
        {"step_s": -1.0},
        {"step_s": "x"},
        {"values": {**data["values"], "stiffness": [-12.0, 8.0]}},
        {"values": {**data["values"], "stiffness": [1e300, 8.0]}},
        {"values": {**data["values"], "damping": [0.1, -5.0]}},
        {"values": {**data["values"], "torque_limit": [1.0, -1.0]}},
        {"values": {**data["values"], "delay": [1e6, 1e6]}},
        {"values": {**data["values"], "delay": [0.0, 0.1]}},
        {"signals": {**data["signals"], "position": ["q1"]}},
        {"signals": {**data["signals"], "position": [1, 2]}},
        {"signals": {**data["signals"], "time_scale": "x"}},
        {"provenance": {**data["provenance"], "inputs": ["x"]}},
        {"free": data["free"] * 100_000},
        {"schema_version": 99},
    ):
        (tmp_path / "model.json").write_text(json.dumps({**data, **change}))
        with pytest.raises(ModelError):
            steelyard.load_actuators(tmp_path)
    assert isinstance(ActuatorModel.from_dict(data), ActuatorModel)


def test_commands_do_the_same(
    found: ActuatorIdentification, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    model = str(folder / "model")
    done = run(app, ["validate", model, str(folder / "servo_other.csv"), "--json"])
    assert done.exit_code == 0, done.output
    (one,) = json.loads(done.output)
    assert set(one["open_loop"]["rms"]) == {"shoulder", "elbow"}
    assert [x["after_s"] for x in one["open_loop"]["drift"]] == [0.1, 0.5, 2.0]
    above = run(app, ["validate", model, str(folder / "servo_other.csv"), "--max-error", "0.1"])
    assert above.exit_code == 1 and "above --max-error" in above.output
    done = run(app, ["export", model, "--to", "mjcf", "-o", "arm.xml"])
    assert done.exit_code == 0 and mujoco.MjModel.from_xml_path("arm.xml").nu == 2
    refused = run(app, ["export", model, "--to", "urdf"])
    assert refused.exit_code == 2 and "--to mjcf" in refused.output
    toml, logs = str(folder / "servos.toml"), str(folder / "servo_fit.csv")
    refused = run(app, ["identify", toml, logs, "--bootstrap", "30"])
    assert refused.exit_code == 2 and "is for identification from efforts" in refused.output
    with pytest.raises(ModelError) as caught:
        steelyard.check(toml, logs)
    assert "check_targets, identify_actuators" in caught.value.fix
    refused = run(app, ["health", model, logs])
    assert refused.exit_code == 2 and "without efforts" in refused.output


def test_init_finds_targets_and_identify_follows(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    table = log(TRUE, 40.0, seed=4)
    names = {"target1": "cmd_shoulder", "target2": "cmd_elbow", "q1": "pos_shoulder"}
    names["q2"] = "pos_elbow"
    pl.DataFrame({names.get(k, k): x for k, x in table.items()}).write_parquet("log.parquet")
    run = CliRunner().invoke
    done = run(app, ["init", str(folder / "servos.urdf"), "log.parquet", "-o", "arm.toml"])
    assert done.exit_code == 0, done.output
    assert "targets are cmd_shoulder, cmd_elbow" in done.output
    done = run(app, ["identify", "arm.toml", "log.parquet", "-o", "out", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["fitted"][0]["open_loop"]["rms"]["elbow"] < 1.5e-3
    assert sorted(p.name for p in Path("out").iterdir()) == ["model.json", "report.html"]


@pytest.mark.parametrize("version", [2, 3])
def test_a_dataset_of_teleoperation_is_identified(
    folder: Path, tmp_path: Path, version: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    frames = []
    for episode in range(4):
        table = log(TRUE, 15.0, seed=20 + episode)
        pairs = {
            name: np.stack([table[f"{short}{j}"] for j in (1, 2)], axis=1).astype(np.float32)
            for name, short in (("action", "target"), ("observation.state", "q"))
        }
        lists = {k: pl.Series(x.tolist(), dtype=pl.List(pl.Float32)) for k, x in pairs.items()}
        rows = {"timestamp": table["time"], "episode_index": np.full(len(table["time"]), episode)}
        frames.append(pl.DataFrame({**lists, **rows}))
    data = Path("data", "chunk-000")
    data.mkdir(parents=True)
    Path("meta").mkdir()
    names = ["shoulder.pos", "elbow.pos"]
    feature = {"dtype": "float32", "shape": [2], "names": names}
    features = {"action": feature, "observation.state": feature}
    info = {"codebase_version": f"v{version}.0", "fps": 50, "features": features}
    Path("meta", "info.json").write_text(json.dumps(info))
    if version == 2:
        for k, frame in enumerate(frames):
            frame.write_parquet(data / f"episode_{k:06d}.parquet")
    else:
        pl.concat(frames).write_parquet(data / "file-000.parquet")
        Path("meta", "episodes").mkdir()
        frames[0].select("timestamp").write_parquet("meta/episodes/file-000.parquet")
    done = CliRunner().invoke(
        app, ["init", str(folder / "servos.urdf"), ".", "-o", "arm.toml", "--no-input"]
    )
    assert done.exit_code == 0, done.output
    assert "targets are action" in done.output.replace("\n", " ")
    fitted = steelyard.identify_actuators("arm.toml", ".#0:2250", ".#2250:3000")
    assert len(fitted.fitted) == 3 and len(fitted.validation) == 1
    assert fitted.validation[0].rms.max() < 1.7e-3


def rewritten(folder: Path, to: Path, name: str = "servo_fit", **columns: np.ndarray) -> Path:
    table = pl.read_csv(folder / f"{name}.csv")
    pl.DataFrame({c: columns.get(c, table[c]) for c in table.columns}).write_csv(to)
    return to


def test_logs_that_cannot_be_used_are_refused_with_the_reason(
    found: ActuatorIdentification, folder: Path, tmp_path: Path
) -> None:
    table, file = pl.read_csv(folder / "servo_fit.csv"), tmp_path / "log.csv"
    t, q = table["time"].to_numpy(), table["q1"].to_numpy()
    far = t.copy()
    far[100] = 1e12
    for columns, wrong in (
        ({"q1": np.full(len(q), np.nan)}, "column 'q1' has no number"),
        ({"time": far}, "rows are not later"),
        ({"time": t[::-1].copy()}, "rows are not later"),
        ({"time": t + 10.0 * np.floor(np.arange(len(t)) / 30)}, "no 50 rows in a row"),
    ):
        rewritten(folder, file, **columns)
        with pytest.raises(LogError, match=wrong):
            steelyard.identify_actuators(folder / "servos.toml", file)
        with pytest.raises(LogError, match=wrong):
            steelyard.validate_actuators(found.model, file)
    huge = table["target1"].to_numpy().copy()
    huge[500] = 1e6
    rewritten(folder, file, target1=huge)
    scored = steelyard.validate_actuators(found.model, file)
    assert "1 rows left out" in scored.notes[0] and scored.validation[0].rms.max() < 2e-3


def test_fitted_motion_is_known_by_its_content(
    found: ActuatorIdentification, folder: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "other_name.csv"
    copy.write_bytes((folder / "servo_fit.csv").read_bytes())
    scored = steelyard.validate_actuators(found.model, [copy, folder / "servo_other.csv"])
    assert scored.fitted == ("other_name",) and len(scored.fresh) == 1
    same = tmp_path / "servo_fit.csv"
    same.write_bytes((folder / "servo_other.csv").read_bytes())
    assert steelyard.validate_actuators(found.model, same).fitted == ()
    part = steelyard.identify_actuators(
        folder / "fixed.toml", f"{folder / 'servo_fit.csv'}@0:40"
    ).model
    here = str(folder / "servo_fit.csv")
    assert steelyard.validate_actuators(part, f"{here}@0:39").fitted == ("servo_fit@:39",)
    assert steelyard.validate_actuators(part, f"{here}@41:60").fitted == ()


def test_a_joint_that_does_not_move_is_named_and_not_identified(
    folder: Path, tmp_path: Path
) -> None:
    table = pl.read_csv(folder / "servo_fit.csv")
    file = rewritten(
        folder,
        tmp_path / "log.csv",
        q2=np.full(len(table), 0.1),
        target2=np.full(len(table), 0.1),
    )
    result = steelyard.identify_actuators(folder / "fixed.toml", file)
    status = {(p.name, p.joint): p.status for p in result.parameters}
    assert status["coulomb", "elbow"] == status["stiffness", "elbow"] == "assumed"
    assert status["coulomb", "shoulder"] == "identified"
    assert any("elbow: no motion" in words for words in result.warnings)


def test_a_torque_limit_that_is_reached_is_found(tmp_path: Path) -> None:
    weak = Servos(torque_limit=(0.8, 0.4))
    made(tmp_path, weak)
    result = steelyard.identify_actuators(
        tmp_path / "servos.toml", tmp_path / "servo_fit.csv", tmp_path / "servo_other.csv"
    )
    limits = {p.joint: p for p in result.parameters if p.name == "torque_limit"}
    assert limits["shoulder"].value == pytest.approx(0.8, rel=0.1)
    assert limits["elbow"].value == pytest.approx(0.4, rel=0.15)
    assert result.validation[0].rms.max() < 0.02


def test_back_emf_is_told_from_the_damping_of_the_controller(tmp_path: Path) -> None:
    one = Servos((9.0,), (0.38,), (0.11,), (0.005,), (1.05,), 0.007, (0.1,), (0.0,), (1.0,), (0.0,))
    (tmp_path / "bench.urdf").write_text(BENCH_URDF)
    (tmp_path / "bench.toml").write_text(BENCH_FILE)
    for k, name in enumerate(("fit", "other")):
        pl.DataFrame(log(one, 60.0, k, 100.0)).write_csv(tmp_path / f"{name}.csv")
    result = steelyard.identify_actuators(
        tmp_path / "bench.toml", tmp_path / "fit.csv", tmp_path / "other.csv"
    )
    tried = {rung.tried: rung for rung in result.law}
    assert tried["+ back_emf"].kept and tried["+ back_emf"].gain > 5.0
    assert not tried["+ load_friction"].kept and tried["+ load_friction"].gain < 5.0
    values = {p.name: p for p in result.parameters}
    for name in ("damping", "back_emf", "torque_limit"):
        interval = values[name].interval
        assert interval is not None and interval[0] < getattr(one, name)[0] < interval[1]
    assert values["back_emf"].value == pytest.approx(0.1, rel=0.2)
    assert result.validation[0].rms[0] < 1.5e-3
    assert "back-EMF" in str(result)


def test_motion_beyond_the_limits_of_the_joints_is_never_good(folder: Path, tmp_path: Path) -> None:
    text = (folder / "servos.toml").read_text()
    (tmp_path / "servos.urdf").write_text(URDF)
    (tmp_path / "servos.toml").write_text(text + "position_offset = [0.0, 3.0]\n")
    result = steelyard.identify_actuators(
        tmp_path / "servos.toml", folder / "servo_fit.csv", folder / "servo_other.csv"
    )
    assert result.verdict.level == "poor"
    assert any("elbow moves over" in words for words in result.warnings)
    with pytest.raises(ModelError, match="cannot be right"):
        actuators_mjcf(result.model)


def test_what_the_model_misses_is_named(
    found: ActuatorIdentification, folder: Path, tmp_path: Path
) -> None:
    table = pl.read_csv(folder / "servo_other.csv")
    q = table["q1"].to_numpy().copy()
    q[600:1800] = q[600]
    file = rewritten(folder, tmp_path / "limp.csv", "servo_other", q1=q)
    scored = steelyard.validate_actuators(found.model, file)
    assert scored.verdict.level != "good"
    assert any("masses are off: shoulder in limp" in words for words in scored.warnings)


@pytest.mark.slow
def test_the_replay_of_the_report_moves_and_fits_the_window(
    folder: Path, found: ActuatorIdentification, browser: Tab
) -> None:
    browser.show(1400)
    browser.open(folder / "model" / "report.html")
    assert wrong_on_screen(browser, ((420, True), (1400, False))) == []
    points = "JSON.stringify(document.querySelector('.space').data.map((one) => one.z.slice(3, 5)))"
    play = "document.querySelector('.replay button').click()"
    first = json.loads(browser.run(points))
    browser.run(
        "{const slider = document.querySelector('.replay input'); slider.value = 20;"
        "slider.dispatchEvent(new Event('input'))}"
    )
    later = json.loads(browser.run(points))
    assert later != first
    arm, one = found.model, found.validation[0]
    row = int(np.searchsorted(one.t - one.t[0], 20.0))
    moved = arm.values.signs * one.q[row] + arm.values["zero"]
    np.testing.assert_allclose(later[0], sticks(arm.robot, moved)[3:5, 2], atol=2e-3)
    assert "20.0 s" in browser.run("document.querySelector('.replay output').textContent")
    browser.run(play)
    assert browser.run("document.querySelector('.replay button').textContent") == "Pause"
    assert browser.run(
        "new Promise((done) => { const slider = document.querySelector('.replay input');"
        "const look = () => (slider.value > 20 ? done(true) : requestAnimationFrame(look));"
        "look() })"
    )
    browser.run(play)
    assert browser.run("document.querySelector('.replay button').textContent") == "Play"
    assert not browser.console


def test_the_replay_ends_at_a_gap_and_shows_what_the_last_joint_moves(
    found: ActuatorIdentification,
) -> None:
    (one,) = found.validation
    half = len(one.t) // 2
    for cut in (half, 1):  # a gap in the middle, and one behind the first row
        later = np.concatenate([one.t[:cut], one.t[cut:] + 10.0])
        page = str(replay_section(found.model, replace(one, t=later)).body)
        length = float(re.search(r'max="([0-9.]+)"', page)[1])  # type: ignore[index]
        whole = max(one.t[cut - 1] - one.t[0], one.t[-1] - one.t[cut])
        assert length == pytest.approx(min(whole, 60.0), abs=0.15)
    q = np.array([[0.3, 0.0], [0.3, 1.0]])
    ends = tips(found.model.robot, q)
    assert ends.shape == (2, 3, 3) and np.abs(ends[0, 1] - ends[1, 1]).max() > 0.05


def test_a_moved_log_is_known_by_what_was_fitted_of_it(folder: Path, tmp_path: Path) -> None:
    log = folder / "servo_fit.csv"
    model = steelyard.identify_actuators(folder / "fixed.toml", f"{log}@0:40").model
    copyfile(log, tmp_path / "moved.csv")
    scored = steelyard.validate_actuators(
        model, [tmp_path / "moved.csv@0:35", tmp_path / "moved.csv@41:60"]
    )
    assert scored.fitted == ("moved@:35",)


def test_heads_of_exports_have_the_unit_of_the_log(found: ActuatorIdentification) -> None:
    signals = replace(found.model.signals, scale=np.array([0.02, 1.0]))
    text = actuators_mjcf(replace(found.model, signals=signals)).text
    assert re.search(r"shoulder: ctrl = \+1 \* \(0.02 \* target", text)
    assert re.search(r"elbow: ctrl = \+1 \* \(target", text)

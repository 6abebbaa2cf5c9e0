"""URDF and MJCF of five real robots, identified from their logs, in Pinocchio and MuJoCo.

Everything by commands, as a user would: `steelyard identify`, then `steelyard export`.
"""

import os
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from proofs.robots.scores import EXAMPLES, file_with, identified
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot

LOGS = {
    "ur10e": "ur10e/identification/ur-20_02_12-40sec_12harm.parquet",
    "panda": "panda/panda_gaz2019_trajectory1.parquet@0.6:9.5",
    "rokae_ar5": "rokae_ar5/ar5_run1_rows0_2300.parquet@0:34",
    "tiago": "tiago/tiago_run1_rows0_5600.parquet#921:4443",
    "tx40": "tx40/tx40_run1.parquet",
}
FORMATS = {"urdf": ".urdf", "mjcf": ".xml"}
SECONDS = 1.0


def exported(model: Path, form: str, *options: str) -> Path:
    """The file that `steelyard export` writes beside the model's folder."""
    path = model.with_name(f"{model.name}{'-'.join(options[:1])}{FORMATS[form]}")
    command = [sys.executable, "-m", "steelyard", "export", str(model), "--to", form]
    subprocess.run([*command, *options, "-o", str(path)], check=True, capture_output=True)
    return path


def simulated(path: Path) -> tuple[int, bool]:
    """Warnings of MuJoCo over a second of free motion, and whether all stays finite."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    while data.time < SECONDS:
        mujoco.mj_step(model, data)
    finite = bool(np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all())
    return sum(warning.number for warning in data.warning), finite


@cache
def motion_of(n: int) -> Motion:
    """Random states."""
    q, dq, ddq = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 100, n))
    return Motion(np.arange(100.0), q, dq, ddq)


def bodies_of(model: IdentifiedModel) -> np.ndarray:
    """Efforts of the identified bodies alone, shape `(N, n)`."""
    values = model.valued.values
    names = [p.name for p in RigidBody().parameters(model.model.robot)]
    kept = type(values)(names, ["1"] * len(names), [values[name] for name in names])
    bodies = Model(model.model.robot, (RigidBody(),))
    return bodies.at(kept).torque(motion_of(bodies.robot.n))


def read_again(path: Path, model: IdentifiedModel) -> np.ndarray:
    """Efforts of a file's bodies, as steelyard reads it."""
    robot, wanted = load_robot(path).robot, model.model.robot
    order = [wanted.joint_names.index(name) for name in robot.joint_names]
    motion = motion_of(wanted.n)
    moved = Motion(motion.t, *(x[:, order] for x in (motion.q, motion.dq, motion.ddq)))
    valued = Model(robot.changed(gravity=wanted.gravity), (RigidBody(),)).prior
    assert valued is not None
    result = np.empty_like(motion.q)
    result[:, order] = valued.torque(moved)
    return result


def pinocchio_torque(path: Path, model: IdentifiedModel) -> np.ndarray:
    """Efforts of a URDF's bodies by Pinocchio; joints that are not the model's rest at zero."""
    robot, motion = model.model.robot, motion_of(model.model.robot.n)
    built = pin.buildModelFromUrdf(str(path))
    built.gravity.linear = np.array(robot.gravity)
    names = list(built.names)[1:]
    data, result = built.createData(), np.zeros_like(motion.q)
    places = {name: robot.joint_names.index(name) for name in names if name in robot.joint_names}
    for k in range(len(motion)):
        q, dq, ddq = np.zeros((3, len(names)))
        for name, at in places.items():
            joint = names.index(name)
            q[joint], dq[joint], ddq[joint] = motion.q[k, at], motion.dq[k, at], motion.ddq[k, at]
        turned = np.concatenate(
            [[np.cos(x), np.sin(x)] if built.nqs[j] == 2 else [x] for j, x in enumerate(q, 1)]
        )
        torque = pin.rnea(built, data, turned, dq, ddq)
        for name, at in places.items():
            result[k, at] = torque[names.index(name)]
    return result


def _robot(robot: str, folder: Path) -> list[Claim]:
    place = folder / robot
    file = file_with("consistent", robot, place.parent)
    identified(robot, [str(data_folder() / LOGS[robot])], [], file=file, output=place)
    model = load_model(place)
    torque = bodies_of(model)
    claims, files = [], {form: exported(place, form) for form in FORMATS}
    edited = exported(place, "urdf", "--model", str(EXAMPLES / f"{robot}.toml"))
    for form, path in files.items():
        warnings, finite = simulated(path)
        figure = f"{warnings} warnings, {'finite' if finite else 'not finite'}"
        holds = warnings == 0 and finite
        claims.append(Claim(f"{robot} {form}, a second of MuJoCo", figure, "0, finite", holds))
    found = {
        "urdf read again": read_again(files["urdf"], model),
        "mjcf read again": read_again(files["mjcf"], model),
        "urdf in Pinocchio": pinocchio_torque(files["urdf"], model),
    }
    for name, other in found.items():
        error = float(np.abs(other - torque).max())
        claims.append(Claim(f"{robot}, {name}", f"{error:.1e} Nm", "<= 1e-9", error <= 1e-9))
    error = float(np.abs(pinocchio_torque(edited, model) - torque).max())
    name = f"{robot}, edited urdf (its own rounded angles) in Pinocchio"
    return [*claims, Claim(name, f"{error:.1e} Nm", "<= 1e-7", error <= 1e-7)]


def main() -> list[Claim]:
    """All five robots."""
    os.environ["STEELYARD_DATA"] = str(data_folder())
    with tempfile.TemporaryDirectory() as folder:
        return [claim for robot in LOGS for claim in _robot(robot, Path(folder))]


if __name__ == "__main__":
    main_of(main)

"""One model file: whether it is a robot, what the reader makes of it, and whether that is right."""

import contextlib
import io
import re
import tempfile
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support.dh_tables import pinocchio_arm, robot_file
from proofs.support.model_facts import not_a_robot, right_to_refuse
from proofs.support.model_files import ModelFile, recognised
from proofs.support.model_oracles import Oracle, PinocchioOracle, urdf_oracle
from proofs.support.mujoco_oracle import MjcfOracle, compiled

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.cli.init_command import init
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.equations.passive_joints import random_positions
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_schema import tomllib
from steelyard.robot.robot import Robot

STATES = 8
AGREES, CLOSELY = 1e-6, 1e-9
"""Largest error of a joint's torque over that joint's largest torque."""
ROUGHLY = 1e-5
"""The same where angles are put right: the reader also cleans products of rotations."""
WEAK = 1e-4
"""Part of the largest torque of all joints that a joint's torques are measured by at least."""
GAP = 1e3
"""Ratio of consecutive singular values that tells a rank."""
ROUNDING = 1e-11
"""Singular values below this, relative to the largest, are rounding."""
TILTED = 1e-8
"""Singular values below this are of angles rounded so far that the reader keeps them (1.57075)."""


@dataclass(frozen=True)
class Severity:
    """What became of one file.

    Attributes:
        kind: `not a robot`, `read right`, `refused rightly`, `refused wrongly`, `wrong`, or
            `no oracle` where it was read and nobody else could.
        why: The class of the file or of the fault.
        detail: What was printed or measured.
        error: Largest relative error of the torque.
        cleaned: Whether it agrees only where rounded angles are put right.
    """

    kind: str
    why: str = ""
    detail: str = ""
    error: float = 0.0
    cleaned: bool = False


def judged(file: ModelFile, say: Callable[[str], None] = lambda stage: None) -> Severity:
    """Read a file as its user would, without a line of code, and hold it against others.

    Args:
        file: The file.
        say: Told `reading` before the reader begins, and `read` when it is done.
    """
    if why := not_a_robot(file):
        return Severity("not a robot", why)
    say("reading")
    try:
        with tempfile.TemporaryDirectory() as name:
            robot, given, used = _loaded(file, Path(name))
            n_base = len(base_parameters(Model(robot, (RigidBody(),))))
            states = _states(robot)
            torque = _torque(robot, states)
    except SteelyardError as error:
        right = right_to_refuse(file, str(error))
        kind = "refused rightly" if right else "refused wrongly"
        return Severity(kind, right or _class_of(error.wrong), str(error))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        return Severity("wrong", f"crash: {type(error).__name__} in {place}", str(error)[:300])
    finally:
        say("read")
    found = Severity("no oracle", "", "")
    for cleaned in (False, True):
        oracle, why = oracle_of(used, cleaned)
        if oracle is None:
            return Severity("no oracle", _class_of(why), why)
        if file.family == "robot file":
            oracle.pull(robot.gravity)
        bound = ROUGHLY if cleaned else AGREES
        found = _compared(oracle, robot, given, (states, torque, n_base), bound)
        if found.kind == "read right":
            return replace(found, cleaned=cleaned)
    return found


def _loaded(file: ModelFile, folder: Path) -> tuple[Robot, Mapping[str, Any], ModelFile]:
    """The robot as `steelyard init` proposes it, the `[robot]` table it wrote, and the model."""
    path = file.path
    if path.suffix == ".py":
        path = folder / "table.toml"
        path.write_text(robot_file(file.root), encoding="utf-8")
    elif path.suffix != ".toml":
        target = folder / "robot.toml"
        with contextlib.redirect_stdout(io.StringIO()):
            _unguarded(init)(path, output=target, as_json=True)
        path = target
    loaded = load_robot(path)
    table = tomllib.loads(path.read_text(encoding="utf-8"))["robot"]
    if file.family == "DH table":
        return loaded.robot, table, file
    model = recognised(loaded.sources[-1].path)
    return loaded.robot, table, file if model is None else model


def _unguarded(command: Any) -> Any:
    """The command itself, whose errors are not yet turned into words and an exit code."""
    return vars(command)["body"]


def _states(robot: Robot) -> tuple[Array, Array, Array]:
    """Positions of all joints, and velocities and accelerations of the independent ones."""
    rng = np.random.default_rng(5)
    q, passive = random_positions(robot, STATES, rng)
    dq, ddq = rng.normal(size=(2, robot.n, STATES))
    return np.vstack([q, passive]), dq, ddq


def _torque(robot: Robot, states: tuple[Array, Array, Array]) -> Array:
    """The reader's torques with the file's bodies, shape `(n, N)`."""
    q, dq, ddq = states
    state = JointState([*q[: robot.n]], [*dq], [*ddq], [*q[robot.n :]])
    rows = Model(robot, (RigidBody(),)).torque_of(state, [float(x) for x in robot.nominal.ravel()])
    return np.array([np.broadcast_to(row, q.shape[1:]) for row in rows])


def oracle_of(file: ModelFile, cleaned: bool) -> tuple[Oracle | None, str]:
    """Another reader of the file, or why there is none."""
    try:
        if file.family == "MJCF":
            model, why = compiled(file.path)
            return (None, why) if model is None else (MjcfOracle(model, cleaned), "")
        if file.family == "URDF":
            return urdf_oracle(file.root, cleaned), ""
        if file.family == "DH table":
            return PinocchioOracle(pinocchio_arm(file.root), {}), ""
    except Exception as error:
        return None, f"{type(error).__name__}: {error}"
    return None, f"no oracle of {file.family}"


def _compared(
    oracle: Oracle,
    robot: Robot,
    given: Mapping[str, Any],
    read: tuple[tuple[Array, Array, Array], Array, int],
    bound: float,
) -> Severity:
    """Torques at states, and the number of base parameters, against the oracle's."""
    states, torque, n_base = read
    names = [c.name for c in robot.joints]
    if strange := [name for name in names if name not in oracle.joints]:
        return Severity("wrong", "joint unknown to the oracle", ", ".join(strange))
    whole, carried = _placed(oracle, names, given.get("locked", {}))
    try:
        q, dq, ddq, down = _closed(oracle, robot, whole, carried, states)
    except ValueError as error:
        return Severity("wrong", "loop open in the oracle", str(error))
    wanted = np.einsum("nij,in->jn", down, oracle.torque(q, dq, ddq))
    largest = np.abs(wanted).max(axis=1)
    scale = np.maximum(largest, WEAK * max(float(largest.max()), 1e-12))
    errors = np.abs(torque - wanted).max(axis=1) / scale
    error, worst = float(errors.max()), int(errors.argmax())
    if not error <= bound:
        detail = f"{names[worst]}: {error:.1e} of {scale[worst]:.3g}"
        return Severity("wrong", "torque differs", detail, error)
    sizes = _sizes(oracle, robot, whole, carried)
    rank = int(np.sum(sizes > ROUNDING * sizes[0]))
    detail = f"{n_base} base parameters, rank {rank} (gap {_drop(sizes, rank):.0e})"
    left_out = sizes[min(n_base, len(sizes) - 1)] / sizes[0]
    unseen = left_out < CLOSELY or (left_out < TILTED and _drop(sizes, n_base) >= GAP)
    if n_base != rank and not (n_base < rank and unseen):
        return Severity("wrong", "number of base parameters", detail, error)
    why = "rank beyond rounding of angles" if n_base != rank else ""
    why = why if error <= AGREES else "within rounding of angles"
    return Severity("read right", why if _drop(sizes, n_base) >= GAP else "no gap", detail, error)


def _drop(sizes: Array, rank: int) -> float:
    """How far singular values drop behind the first `rank` of them."""
    return float(sizes[rank - 1] / max(sizes[rank], 1e-17 * sizes[0]))


def _placed(oracle: Oracle, names: list[str], locked: Mapping[str, float]) -> tuple[Array, Array]:
    """Positions of the oracle's joints: `start + carried @ q` with the robot's joints `q`."""
    start, carried = np.zeros(len(oracle.joints)), np.zeros((len(oracle.joints), len(names)))
    for row, joint in enumerate(oracle.joints):
        ratio, offset, name = 1.0, 0.0, joint
        while name not in names and name not in locked and name in oracle.following:
            follows = oracle.following[name]
            offset += ratio * follows.offset
            ratio *= follows.ratio
            name = follows.master
        if name in names:
            start[row] = offset
            carried[row, names.index(name)] = ratio
        else:
            start[row] = offset + ratio * locked.get(name, oracle.rest.get(name, 0.0))
    return start, carried


def _closed(
    oracle: Oracle,
    robot: Robot,
    start: Array,
    carried: Array,
    states: tuple[Array, Array, Array],
) -> tuple[Array, Array, Array, Array]:
    """The motion of the oracle's joints, shapes `(n_o, N)`, and per sample what maps torques down.

    Velocities of joints that loops determine come from the slopes of the oracle's pins.
    """
    q, dq, ddq = states
    whole = start[:, None] + carried @ q
    n, maps, speeds, rates = robot.n, [], [], []
    for k in range(q.shape[1]):
        lacks, slopes, rate = oracle.gaps(whole[:, k])
        if not robot.passive:
            maps.append(carried)
            speeds.append(carried @ dq[:, k])
            rates.append(carried @ ddq[:, k])
            continue
        if np.abs(lacks).max() > 1e-6:
            raise ValueError(f"the oracle's pins are {np.abs(lacks).max():.1e} m open")
        slopes = slopes @ carried
        inverse = np.linalg.pinv(slopes[:, n:], rcond=1e-7)
        turn = np.vstack([np.eye(n), -inverse @ slopes[:, :n]])
        speed = carried @ turn @ dq[:, k]
        drift = np.concatenate([np.zeros(n), -inverse @ rate(speed)])
        maps.append(carried @ turn)
        speeds.append(speed)
        rates.append(carried @ (turn @ ddq[:, k] + drift))
    return whole, np.array(speeds).T, np.array(rates).T, np.array(maps)


def _sizes(oracle: Oracle, robot: Robot, start: Array, carried: Array) -> Array:
    """Singular values of the oracle's regressor over random states, and zeros behind them."""
    count = 20 * len(oracle.joints) // robot.n + 10
    rng = np.random.default_rng(11)
    q, passive = random_positions(robot, count, rng)
    states = np.vstack([q, passive]), *rng.normal(size=(2, robot.n, count))
    whole, dq, ddq, down = _closed(oracle, robot, start, carried, states)
    entries = np.einsum("nij,inp->jnp", down, oracle.regressor(whole, dq, ddq))
    matrix = entries.reshape(-1, entries.shape[2])
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return np.concatenate([sizes, np.zeros(10 * len(robot.bodies) + 1)])


def _class_of(text: str) -> str:
    """A message without its names and numbers."""
    short = re.sub(r"'[^']*'|\"[^\"]*\"", "'…'", text.split("\n")[0])
    short = re.sub(r"\S*/\S+", "PATH", re.sub(r"-?\d[\d.e+-]*", "#", short))
    return re.sub(r"('…'(, | and )?)+", "'…' ", short)[:110]

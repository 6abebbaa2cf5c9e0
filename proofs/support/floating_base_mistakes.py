"""Mistakes in logs of legged robots and their robot files, planted one at a time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from steelyard.base.arrays import Array

Columns = dict[str, Array]
Change = Callable[[Columns, str], str]
"""Changes the columns of a log in place, and returns the text of the robot file."""
G = 9.81  # m/s²
LATE = 0.03  # s
BIAS = 0.15  # m/s²
ELSEWHERE = (0.15, 0.1, 0.15)  # how far the sensor really is from where the file says [m]


@dataclass(frozen=True)
class Mistake:
    """One mistake: what it is, and words of which a finding that names it has all of one group."""

    name: str
    plant: Change
    named: tuple[tuple[str, ...], ...]

    def write(self, log: Path, file: Path, folder: Path) -> tuple[Path, Path]:
        """A log and a robot file with the mistake."""
        frame = pl.read_parquet(log)
        columns = {name: frame[name].to_numpy().copy() for name in frame.columns}
        text = self.plant(columns, file.read_text())
        folder.mkdir(parents=True, exist_ok=True)
        wrong, changed = folder / "log.parquet", folder / "robot.toml"
        pl.DataFrame(columns).write_parquet(wrong)
        changed.write_text(text)
        return wrong, changed


def _of_columns(change: Callable[[Columns], None]) -> Change:
    def plant(columns: Columns, text: str) -> str:
        change(columns)
        return text

    return plant


def _of_file(old: str, new: str) -> Change:
    def plant(columns: Columns, text: str) -> str:
        assert old in text, old
        return text.replace(old, new)

    return plant


def _scaled(names: Sequence[str], factor: float) -> Change:
    def change(columns: Columns) -> None:
        for name in names:
            columns[name] *= factor

    return _of_columns(change)


def _exchanged(pairs: Sequence[tuple[str, str]]) -> Change:
    def change(columns: Columns) -> None:
        for a, b in pairs:
            columns[a], columns[b] = columns[b], columns[a]

    return _of_columns(change)


def _frozen(names: Sequence[str]) -> Change:
    def change(columns: Columns) -> None:
        for name in names:
            start = len(columns[name]) // 3
            columns[name][start:] = columns[name][start]

    return _of_columns(change)


def rotated(columns: Columns) -> Array:
    """Axes of the inertial sensor in the world, `(N, 3, 3)`."""
    from scipy.spatial.transform import Rotation

    order = [columns[f"quat_{x}"] for x in "xyzw"]
    return np.asarray(Rotation.from_quat(np.column_stack(order)).as_matrix())


def _biased(columns: Columns) -> None:
    columns["acc_z"] += BIAS


def _without_gravity(columns: Columns) -> None:
    up = rotated(columns)[:, 2]
    for k, axis in enumerate("xyz"):
        columns[f"acc_{axis}"] -= G * up[:, k]


def _late(columns: Columns) -> None:
    t = columns["t"]
    for name in [n for n in columns if n.split("_")[0] in ("acc", "gyro", "quat")]:
        columns[name] = np.interp(t - LATE, t, columns[name])


def _other_order(columns: Columns) -> None:
    old = [columns[f"quat_{x}"] for x in "xyzw"]
    for x, values in zip("wxyz", old, strict=True):
        columns[f"quat_{x}"] = values


def _all(kind: str, parts: Sequence[str], feet: Sequence[str]) -> list[str]:
    return [f"{kind}_{foot}_{x}" for foot in feet for x in parts]


def _wrenches(feet: Sequence[str]) -> list[str]:
    return _all("force", "xyz", feet) + _all("moment", "xyz", feet)


ACC, GYRO = ([f"{kind}_{x}" for x in "xyz"] for kind in ("acc", "gyro"))


def of_sensor() -> list[Mistake]:
    """Those of the inertial sensor, on any robot."""
    return [
        Mistake(
            "inertial sensor turned by 90°",
            _of_file("yaw = 30.0", "yaw = -60.0"),
            (("sensor mounting",),),
        ),
        Mistake(
            "mounting of the sensor left out",
            _of_file("roll = 10.0, pitch = -5.0, yaw = 30.0", "roll = 0.0, pitch = 0.0, yaw = 0.0"),
            (("sensor mounting",),),
        ),
        Mistake(
            "quaternion in the other order", _of_columns(_other_order), (("orientation", "xyzw"),)
        ),
        Mistake("gyroscope in deg/s", _scaled(GYRO, 180.0 / np.pi), (("deg/s",),)),
        Mistake("accelerometer in g", _scaled(ACC, 1.0 / 9.80665), (('"g"',),)),
        Mistake(
            "accelerometer without gravity", _of_columns(_without_gravity), (("without gravity",),)
        ),
        Mistake(
            "accelerometer with the opposite sign",
            _scaled(ACC, -1.0),
            (("acceleration", "opposite sign"),),
        ),
        Mistake(
            "accelerometer with a bias along its z axis",
            _of_columns(_biased),
            (("accelerometer bias", "bias of"),),
        ),
        Mistake(
            "inertial sensor on another place",
            _of_file(
                "position = [0.05, -0.02, 0.03]",
                f"position = {[0.05 + ELSEWHERE[0], -0.02 + ELSEWHERE[1], 0.03 + ELSEWHERE[2]]}",
            ),
            (("sensor place", "another place"),),
        ),
        Mistake("inertial sensor late by 30 ms", _of_columns(_late), (("sensor delay",),)),
        Mistake("gyroscope frozen", _frozen(GYRO), (("gyro_", "one value"),)),
    ]


def of_joints(first: str, second: str, left: Sequence[str], right: Sequence[str]) -> list[Mistake]:
    """Those of the joints: of two of one limb, and of the joints of two limbs."""
    pairs = [
        (f"{kind}_{a}", f"{kind}_{b}")
        for kind in ("q", "tau")
        for a, b in zip(left, right, strict=True)
    ]
    two = [(f"{kind}_{first}", f"{kind}_{second}") for kind in ("q", "tau")]
    return [
        Mistake(
            "left and right legs exchanged in the columns",
            _exchanged(pairs),
            (("joint order", "exchanged"),),
        ),
        Mistake("two joints exchanged", _exchanged(two), (("joint order", first, second),)),
        Mistake(
            "sign of a joint's position", _scaled([f"q_{first}"], -1.0), (("position sign", first),)
        ),
        Mistake(
            "sign of a joint's effort", _scaled([f"tau_{second}"], -1.0), (("effort sign", second),)
        ),
        Mistake(
            "effort of a joint times 1.5", _scaled([f"tau_{second}"], 1.5), (("gain", second),)
        ),
    ]


def degrees(columns: Columns, text: str) -> str:
    """Positions in degrees that are declared as radians."""
    for name in [n for n in columns if n.startswith("q_")]:
        columns[name] = np.rad2deg(columns[name])
    return text


def of_contacts(feet: Sequence[str], declared_axes: str) -> list[Mistake]:
    """Those of measured wrenches."""
    other = "frame" if declared_axes == "world" else "world"
    first, every = feet[0], _wrenches(feet)
    found = [
        Mistake(
            "force of a contact with the opposite sign",
            _scaled(_wrenches([first]), -1.0),
            (("contacts", "opposite sign"),),
        ),
        Mistake(
            "force of a contact zero", _scaled(_wrenches([first]), 0.0), (("one value", first),)
        ),
        Mistake("force of a contact frozen", _frozen(_wrenches([first])), (("one value", first),)),
        Mistake(
            f"forces along the axes of the {other}",
            _of_file(f'axes = "{declared_axes}"', f'axes = "{other}"'),
            (("contacts", "axes"),),
        ),
        Mistake("forces in kilograms", _scaled(every, 1.0 / G), (("contacts", "factor"),)),
        Mistake(
            "scale of one force 1.3", _scaled(_wrenches([first]), 1.3), (("contacts", "factor"),)
        ),
    ]
    if len(feet) > 1:
        second = feet[1]
        pairs = list(zip(_wrenches([first]), _wrenches([second]), strict=True))
        found.append(
            Mistake("forces of two feet exchanged", _exchanged(pairs), (("contacts", "exchanged"),))
        )
        found.append(
            Mistake(
                "all forces with the opposite sign",
                _scaled(every, -1.0),
                (("contacts", "opposite sign"),),
            )
        )
        found.append(
            Mistake(
                "a contact that is not declared",
                _undeclared(first),
                (("contacts", "not measured", first),),
            )
        )
    return found


def _undeclared(foot: str) -> Change:
    def plant(columns: Columns, text: str) -> str:
        parts = text.split("[[signals.base.contacts]]")
        kept = [part for part in parts if f'frame = "{foot}"' not in part]
        assert len(kept) == len(parts) - 1
        return "[[signals.base.contacts]]".join(kept)

    return plant


def gravity_compensated(robot_file: Path) -> Change:
    """Efforts without the weight of the model file's bodies, as some controllers report them."""

    def plant(columns: Columns, text: str) -> str:
        from steelyard import Motion, load_robot, model_of

        model = model_of(load_robot(robot_file)).prior
        assert model is not None
        names = model.model.robot.joint_names[6:]
        q = np.column_stack([columns[f"q_{name}"] for name in names])
        up = rotated(columns)[:, 2] @ _mounted().T
        still = np.zeros_like(q)
        rest = np.zeros((len(q), 3))
        motion = Motion.floating(
            columns["t"], q, still, still,
            proper_acceleration=G * up, angular_velocity=rest, angular_acceleration=rest,
        )  # fmt: skip
        weight = model.torque(motion)[:, 6:]
        for k, name in enumerate(names):
            columns[f"tau_{name}"] -= weight[:, k]
        return text

    return plant


def _mounted() -> Array:
    from proofs.support.legged_robots import TURNED

    from steelyard.robot.inertia_and_placement import rpy_rotation

    return np.asarray(rpy_rotation(*np.deg2rad(TURNED)))


def mistakes_of(name: str, file: Path) -> list[Mistake]:
    """All mistakes of a robot."""
    if name == "A1":
        ends = ("hip_joint", "thigh_joint", "calf_joint")
        left, right = (
            [f"{leg}_{end}" for leg in legs for end in ends]
            for legs in (("FL", "RL"), ("FR", "RR"))
        )
        joints = of_joints("FR_thigh_joint", "FR_calf_joint", left, right)
        contacts = of_contacts(("FR_calf", "FL_calf", "RR_calf", "RL_calf"), "world")
    else:
        ends = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
        left, right = ([f"{side}_{end}_joint" for end in ends] for side in ("left", "right"))
        joints = of_joints("left_hip_pitch_joint", "left_knee_joint", left, right)
        contacts = of_contacts(("pelvis",), "frame")
    more = [
        Mistake("positions in degrees", degrees, (("position", "deg"),)),
        Mistake(
            "gravity-compensated efforts", gravity_compensated(file), (("effort kind", "gravity"),)
        ),
    ]
    return [*of_sensor(), *joints, *more, *contacts]

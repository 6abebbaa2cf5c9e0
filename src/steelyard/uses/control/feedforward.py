r"""Torques of an identified model along a motion: what `steelyard feedforward` does.

Friction is that of the *desired* velocity. Laws that jump at zero velocity turn within a speed $w$,
$\tanh(\dot q_d / w)$ in the place of the sign [Volkmann], because a desired velocity is rarely
exactly zero at rest; laws with a smoothing of their own keep that.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Array, finite_json, records
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, ModelError, refuse_unknown
from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel, far_beyond_limits, load_model
from steelyard.estimate.scores.effort_errors import known_efforts
from steelyard.excite.controller_file_formats import grid_times
from steelyard.excite.trajectories.trajectory_files import read_named, read_table
from steelyard.logs.formats import write_table
from steelyard.model.model import ValuedModel
from steelyard.model.torque_and_quantities import TORQUE, Equations, Quantity
from steelyard.robot.robot import Coordinate, Robot
from steelyard.symbolic.program_and_softening import Program, softened
from steelyard.uses.control.contacts_carry_base import (
    SHARED_NOTE,
    CarriedBase,
    base_motion_of_table,
    carried_base,
)

SIGN_SMOOTHING = 1e-3  # speed within which friction by the plain sign turns [rad/s; m/s]


@dataclass(frozen=True, eq=False)
class SmoothedQuantity(Quantity):
    """A quantity whose jumps at zero velocity are spread over a speed `width` [rad/s; m/s]."""

    width: float = SIGN_SMOOTHING

    def program(self, part: Equations, stepped: bool = False) -> Program:
        """The program of the quantity, softened."""
        plain = super().program(part, stepped)
        return softened(plain, self.arguments.index("dq"), self.width)


@lru_cache(maxsize=64)
def smoothed(quantity: Quantity, width: float) -> Quantity:
    """A quantity with its jumps at zero velocity spread over a speed; zero leaves it as it is."""
    if width == 0.0:
        return quantity
    own = vars(quantity) | {"name": f"{quantity.name}, smoothed", "key": (*quantity.key, width)}
    return SmoothedQuantity(**own, width=width)


def feedforward_torque(
    valued: ValuedModel,
    motion: Motion,
    smoothing: float = SIGN_SMOOTHING,
    quantity: Quantity = TORQUE,
) -> Array:
    """Joint torques of a model, or those of a quantity, along a motion, shape `(N, n)` [Nm; N].

    Friction with memory begins at rest. Laws that jump at zero velocity turn within the speed
    `smoothing` [rad/s; m/s]; zero for the plain sign.
    """
    chosen = smoothed(quantity, smoothing)
    return valued.evaluate(chosen, motion.q, motion.dq, motion.ddq, t=motion.t)


def in_joint_order(
    motion: Motion, joints: Sequence[str] | None, robot: Robot, where: str
) -> Motion:
    """The motion of a robot's joints, in their order, which is that of columns without names."""
    if joints is None:
        if motion.n_joints == robot.n:
            return motion
        raise DataError(
            f"the motion has {motion.n_joints} joints without names, the model {robot.n}",
            where=where,
            fix=f"name its joints; the model has {', '.join(robot.joint_names)}",
        )
    if len(joints) != motion.n_joints or len(set(joints)) != len(joints):
        raise DataError(
            f"{len(joints)} names are given for the {motion.n_joints} joints of the motion, or one "
            "twice",
            where=where,
            fix="give one name per column, each once",
        )
    for wanted, known, lacks, has in (
        (robot.joint_names, joints, "motion", "the model has"),
        (joints, robot.joint_names, "model", "the motion moves"),
    ):
        for name in wanted:
            wrong = f"the {lacks} has no joint '{name}', which {has}"
            refuse_unknown(name, known, wrong, where, f"joints of the {lacks}", DataError)
    order = np.array([list(joints).index(name) for name in robot.joint_names])
    return Motion(motion.t, *(x[:, order] for x in (motion.q, motion.dq, motion.ddq)))


def refuse_unknown_gains(identified: IdentifiedModel) -> None:
    """Efforts of the model are torques."""
    unknown = list(identified.signals.unknown_gains)
    if not any(unknown):
        unknown = [not known for known in known_efforts(identified)]
    if any(unknown):
        joint = identified.joints[unknown.index(True)]
        raise ModelError(
            f"the drive gain of joint '{joint}' is unknown: the model's efforts are no torques",
            where=f"model of '{identified.model.robot.name}', gains of its effort columns",
            fix="identify the gains with a payload (steelyard identify ROBOT LOG --loaded LOG "
            "--payload-mass KG), or give them in [signals.effort] gain",
        )


def refuse_other_robot(identified: IdentifiedModel, robot: Robot) -> None:
    """The model is one of a robot that is controlled by joint torques."""
    model = identified.model.robot
    where = f"model of '{model.name}', robot '{robot.name}'"
    if model.joint_names != robot.joint_names:
        raise ModelError(
            f"the model has the joints {', '.join(model.joint_names)}, the robot "
            f"{', '.join(robot.joint_names)}",
            where=where,
            fix="give a model of this robot, with the joints in the same order",
        )
    if not np.allclose(model.gravity, robot.gravity, atol=1e-6):
        compensated = identified.signals.effort_kind == "gravity_compensated_torque"
        raise ModelError(
            "the model was identified from gravity-compensated efforts: it has no gravity, but "
            "the joint torques of the robot need it"
            if compensated
            else "the model and the robot are mounted differently: their gravity differs",
            where=where,
            fix="identify from joint torques, or give the robot file that the model was "
            "identified with",
        )


def remarks_on_torques(identified: IdentifiedModel) -> tuple[str, ...]:
    """What the torques of the model leave out, a sentence each."""
    kind, scales = identified.signals.effort_kind, identified.effort_scales
    found = []
    if kind == "gravity_compensated_torque":
        found.append(
            "torques are without gravity: they are for a controller that adds gravity itself"
        )
    if kind == "link_torque":
        found.append(
            "torques are those on the link side: inertia and friction of the motors are not in them"
        )
    if identified.model.n_channels > len(identified.model.robot.passive):
        found.append(
            "friction with memory is zero at first from rest; a motion that begins moving is "
            "taken to have moved at that speed before"
        )
    if scales is not None:
        found.append(
            f"torques are those of the model: logged efforts are {scales.words} times as large "
            "(estimated effort scales)"
        )
    return tuple(found)


FEEDFORWARD_RATE = 250.0  # rows a second of the table, if none is given
FEWEST_ROWS, LEAST_NOISE = 20, 1.0
"""Rows of a table from which on noise is sought, and the least RMS of its accelerations that
matters [rad/s²; m/s²]."""


@dataclass(frozen=True, eq=False, repr=False)
class FeedforwardTorques:
    """Torques along a motion of the joints; of a floating base, with what contacts `carried`."""

    joints: tuple[Coordinate, ...]
    motion: Motion
    torque: Array  # shape `(N, n)` [Nm; N]
    notes: tuple[str, ...] = ()  # what the torques leave out
    # what speaks against commanding them: torques beyond the limits of their joints, accelerations
    # that are noise, angles far beyond the limits; and what to do
    warnings: tuple[str, ...] = ()
    carried: CarriedBase | None = None

    def __repr__(self) -> str:
        return f"FeedforwardTorques({len(self.motion)} samples, {len(self.joints)} joints)"

    def __str__(self) -> str:
        width = max(len(joint.name) for joint in self.joints)
        joints = (
            f"{joint.name:{width}}  RMS {rms:.4g}, largest {peak:.4g} {joint.effort_unit}"
            for joint, rms, peak in zip(self.joints, self.rms, self.peaks, strict=True)
        )
        notes = (*(f"! {one}" for one in self.warnings), *(f"note: {one}" for one in self.notes))
        return "\n".join([f"{len(self.motion)} samples", *joints, *self.contact_lines, *notes])

    @property
    def contact_lines(self) -> list[str]:
        """A line for each contact: the load that it carries, and the friction that it needs."""
        return [
            f"{name}: carries {least:.3g} to {most:.3g} N"
            + (f", needs a friction of {friction:.2f}" if np.isfinite(friction) else "")
            for name, least, most, friction in (self.carried.loads() if self.carried else ())
        ]

    @property
    def peaks(self) -> Array:
        """Largest torque of each joint, shape `(n,)` [Nm; N]."""
        return np.asarray(np.abs(self.torque).max(axis=0))

    @property
    def rms(self) -> Array:
        """Root mean square torque of each joint, shape `(n,)` [Nm; N]."""
        return np.asarray(np.sqrt(np.mean(self.torque**2, axis=0)))

    def write(self, path: str | Path) -> None:
        """Write a table: `time_s`, then `q_NAME`, `dq_NAME`, `ddq_NAME` and `tau_NAME`, SI units.

        Of a floating base also `force_NAME_x` to `force_NAME_z` of contacts, along its axes, and of
        soles `moment_NAME_x` to `moment_NAME_z`.

        Args:
            path: A name that ends in `.csv` or `.parquet`.
        """
        motion, columns = self.motion, {"time_s": self.motion.t}
        values = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq, "tau": self.torque}
        for what, samples in values.items():
            for joint, column in zip(self.joints, samples.T, strict=True):
                columns[f"{what}_{joint.name}"] = column
        for name, force in (self.carried.forces if self.carried else {}).items():
            for k, column in enumerate(force.T):
                columns[f"{('force', 'moment')[k // 3]}_{name}_{'xyz'[k % 3]}"] = column
        write_table(Path(path), columns)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, without the samples."""
        names, units = ((x.name for x in self.joints), (x.effort_unit for x in self.joints))
        return {
            "duration_s": float(self.motion.t[-1] - self.motion.t[0]),
            "samples": len(self.motion),
            "joints": records(name=names, unit=units, rms=self.rms, peak=self.peaks),
            "contacts": [
                {
                    "name": name,
                    "least_n": least,
                    "largest_n": most,
                    "friction": finite_json(friction),
                }
                for name, least, most, friction in (self.carried.loads() if self.carried else ())
            ],
            "notes": list(self.notes),
            "warnings": list(self.warnings),
        }


@checked(rate=1.0, smoothing=0.0)
def feedforward(
    model: str | Path | IdentifiedModel,
    motion: str | Path | Motion,
    *,
    joints: Sequence[str] | None = None,
    rate: float = FEEDFORWARD_RATE,
    smoothing: float = SIGN_SMOOTHING,
    as_logged: bool = False,
    contacts: Sequence[str] | None = None,
    forces: Mapping[str, ArrayLike] | None = None,
) -> FeedforwardTorques:
    """Torques along a desired motion, for a controller that adds them to its own.

    Friction is that of the desired velocity. Laws with a smoothing in the robot file keep it;
    others that jump at zero velocity turn within `smoothing`. A floating base is carried by
    contacts, whose forces are the least that do it unless they are given.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        motion: `trajectory.json`, a table of times and positions, or samples (`Motion`); joints are
            matched by name. A table keeps its times, and may begin and end moving.
        joints: Names of the columns of samples; those of the model in its order if `None`.
        rate: Rows per second along a file.
        smoothing: Speed [rad/s; m/s] over which the sign function of friction laws is smoothed; 0
            for the sign itself. A law with a smoothing in the robot file keeps it.
        as_logged: Torques in Nm (N) as the robot file reads them from the log: multiplied by the
            estimated effort scales of the model, if it has any. For currents, divide by the robot
            file's gain, as `IdentifiedModel.effort` does.
        contacts: Contacts of the robot file, by frame, that carry a floating base during the whole
            motion; all of them if left out.
        forces: Of the world on frames of a robot with a floating base, instead of the least ones:
            along the axes of the base, `(N, 3)`, or with the moment about the frame's origin
            `(N, 6)` [N, Nm].

    Raises:
        SteelyardError: A file cannot be used, a joint is missing, or the model's efforts are no
            torques.

    Example:
        >>> ahead = feedforward("arm-model", "fit/trajectory.json", rate=100.0)
        >>> ahead.torque.shape == ahead.motion.q.shape
        True
    """
    identified = load_model(model)
    refuse_unknown_gains(identified)
    robot = identified.model.robot
    if (contacts is not None or forces is not None) and not robot.floating:
        raise DataError(
            "contacts carry a robot whose base floats, and this one's is fixed",
            where="contacts" if forces is None else "forces",
            fix="leave them out",
        )
    if contacts is not None and forces is not None:
        wrong = "contacts that share the load are named together with forces that are given"
        raise DataError(wrong, where="contacts, forces", fix="give one of the two")
    samples, measured = _samples(motion, joints, robot, rate)
    far, up = far_beyond_limits(robot, samples.q), None
    if robot.floating and not isinstance(motion, Motion):
        assert identified.signals.base is not None
        samples, up = base_motion_of_table(identified.signals.base, robot, samples)
    torque, carried = feedforward_torque(identified.valued, samples, smoothing), None
    moved = robot.coordinates[robot.n_base :]
    shared, warnings = tuple[str, ...](), tuple[str, ...]()
    if robot.floating:
        carried = carried_base(identified, samples, torque, up, contacts, forces)
        torque, warnings = carried.torque, tuple(carried.warnings(samples.t))
        shared = (SHARED_NOTE,) if carried.forces and forces is None else ()
        joint_rows = (x[:, robot.n_base :] for x in (samples.q, samples.dq, samples.ddq))
        samples = Motion(samples.t, *joint_rows)
    if as_logged and identified.effort_scales is not None:
        torque = torque * identified.effort_scales.values
        identified = replace(identified, effort_scales=None)
    if far:
        advice = "do not command these torques; positions are in rad, convert degrees"
        warnings = (f"{far}: {advice}",)
    else:
        warnings += tuple(beyond_limits(moved, samples, torque, measured))
    notes = (*remarks_on_torques(identified), *shared)
    return FeedforwardTorques(moved, samples, torque, notes, warnings, carried)


def beyond_limits(
    joints: Sequence[Coordinate], motion: Motion, torque: Array, measured: Sequence[str] = ()
) -> Iterator[str]:
    """What speaks against commanding torques `(N, n)` [Nm; N] along a motion, and what to do.

    `measured` are the joints whose positions in the table are measured ones with noise.
    """
    found = False
    for joint, column, ddq in zip(joints, torque.T, motion.ddq.T, strict=True):
        above = np.abs(column) > joint.limits.effort
        if above.any():
            found = True
            k = int(np.argmax(np.abs(column)))
            yield (
                f"{joint.name}: {abs(column[k]):.3g} {joint.effort_unit} at {motion.t[k]:.3f} s is "
                f"beyond its limit of {joint.limits.effort:.4g} (acceleration {ddq[k]:.3g}; "
                f"{above.sum()} of {len(column)} samples)"
            )
    if measured:
        yield (
            f"do not command these torques: accelerations of {', '.join(measured)} reverse from "
            "row to row, as those of measured positions, whose noise they contain; smooth the "
            "positions, or give a planned motion"
        )
    elif found:
        yield "do not command these torques: give a slower motion, or smooth measured positions"


def _samples(
    motion: str | Path | Motion, joints: Sequence[str] | None, robot: Robot, rate: float
) -> tuple[Motion, tuple[str, ...]]:
    """The motion of the robot's joints, in their order; joints whose table has noise."""
    if isinstance(motion, Motion):
        return in_joint_order(motion, joints, robot, "samples of the motion"), ()
    if joints is not None:
        wrong = "names of joints are given together with a file, which has its own"
        fix = "leave them out"
        raise DataError(wrong, where="joints", fix=fix)
    path = Path(motion)
    if path.suffix == ".json":
        trajectory, names = read_named(path)
        found = trajectory.sample(grid_times(trajectory.duration, rate))
        return in_joint_order(found, names, robot, str(path)), ()
    table = read_table(path, robot)
    found = table.unstopped.sample(grid_times(table.motion.duration, rate))
    noisy = np.array(robot.joint_names)[_noisy(table.motion.t, table.motion.q)]
    return Motion(table.start + found.t, found.q, found.dq, found.ddq), tuple(noisy.tolist())


def _noisy(t: Array, q: Array) -> NDArray[np.bool_]:
    """Whether second differences of positions `(N, n)` are mostly noise, shape `(n,)`.

    Those of white noise have a correlation of -2/3 from row to row, those of a motion that the rows
    resolve a positive one.
    """
    if len(t) < FEWEST_ROWS:
        return np.zeros(q.shape[1], dtype=np.bool_)
    step = np.diff(t)[:, None]
    acceleration = np.diff(np.diff(q, axis=0) / step, axis=0) / (0.5 * (step[1:] + step[:-1]))
    large = np.sqrt(np.mean(np.square(acceleration), axis=0)) > LEAST_NOISE
    return np.asarray(large & (np.sum(acceleration[1:] * acceleration[:-1], axis=0) < 0.0))

"""Identified actuators: what `steelyard identify` writes where joints follow position targets."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from steelyard.actuators.actuator_parameters import (
    BY_NAME,
    KINDS,
    UNLIMITED,
    ActuatorValues,
    Free,
)
from steelyard.actuators.choice import WIDE
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.base.arrays import Z95, Array, frozen, json_values
from steelyard.base.errors import ModelError
from steelyard.base.files import read_json
from steelyard.estimate.identified_model import OF_ACTUATORS as SCHEMA
from steelyard.estimate.identified_model import Provenance
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.signals import TargetSignals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot, robot_from_dict, robot_to_dict

SCHEMA_VERSION = 3

BEYOND_LIMITS = 0.2  # how far motion may leave the limits of a model file [rad; m]
LONGEST_DELAY = 2.0  # [s]
LEAST_STEP, MOST_STEP = 1e-4, 0.05  # of rollouts [s]

OF_JOINTS = ("assumed", "still", "open_signs", "beyond_limits")  # fields that are names of joints
POSITIVE = ("stiffness", "armature", "torque_limit", "stribeck_speed", "mass_factor")
LATER = ("mass_factor", "integral")  # parameters that models of earlier versions do not name
MOST_VARIANCE = 1e4  # of a value's logarithm
IDENTIFIED = 0.75
"""Share of the prior's variance that the data take away from what counts as identified."""


@dataclass(frozen=True)
class ActuatorParameter:
    """One parameter of one joint, or of all: its value and 95 % interval, and where it is from.

    `status` is `identified`, `not identifiable` (the interval is wide, or mostly the prior's),
    `assumed` (like the other joints: the stiffness where neither gravity nor inertia shows it, all
    of a joint that does not move),
    `stated` or `not in the law`; the interval is `None` of the last two, and of what is assumed of
    a joint that does not move.
    """

    name: str
    joint: str
    unit: str
    value: float
    interval: tuple[float, float] | None
    status: str

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {**vars(self), "interval": None if self.interval is None else [*self.interval]}


GainStatus = Literal["stated", "identified", "contradicted", "not shown"]


@dataclass(frozen=True)
class EffortGain:
    """Torque of a joint per logged effort.

    `status` is `stated`, `identified` (its interval contains that of the torques' scale),
    `contradicted` (what is stated does not fit the log) or `not shown`; `reason` says why.
    `follows` is the correlation of efforts with the torque of the controller, without what other
    causes explain; `by_masses` the gain with which torques have the scale of the masses in the
    model file, where their weight shows it.
    """

    joint: str
    unit: str
    value: float | None
    interval: tuple[float, float] | None
    status: GainStatus
    reason: str = ""
    follows: float | None = None
    by_masses: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {**vars(self), "interval": None if self.interval is None else [*self.interval]}


def gains_from(data: Sequence[Mapping[str, Any]], joints: Sequence[str]) -> tuple[EffortGain, ...]:
    """Gains of efforts that `to_dict` wrote, of these joints.

    `KeyError`, `ValueError` or `TypeError` if damaged.
    """
    if data and [one["joint"] for one in data] != [*joints]:
        raise ValueError("'efforts' are not those of the joints")
    return tuple(_gain_from(one) for one in data)


def _gain_from(data: Mapping[str, Any]) -> EffortGain:
    numbers = {key: data[key] for key in ("value", "follows", "by_masses") if data[key] is not None}
    low, high = data["interval"] or (-np.inf, np.inf)
    sizes = [float(x) for x in numbers.values()]
    if not np.isfinite(sizes).all() or not low <= numbers.get("value", low) <= high:
        raise ValueError("a gain of efforts is not finite, or beside its interval")
    if numbers.get("value") == 0.0 or data["status"] not in get_args(GainStatus):
        raise ValueError("a gain of efforts is zero, or its status none that there is")
    if not all(isinstance(data[key], str) for key in ("unit", "reason")):
        raise ValueError("a unit or reason of efforts is no text")
    interval = data["interval"] and (float(low), float(high))
    return EffortGain(**{**data, "interval": interval})


def reach_of(values: ActuatorValues, q: Array) -> Array:
    """Least and greatest positions of the model's joints in a log `(N, n)`, `(n, 2)`."""
    moved = values.signs * q + values["zero"]
    return np.stack([moved.min(axis=0), moved.max(axis=0)], axis=1)


def outside_limits(
    robot: Robot, values: ActuatorValues, q: Array, least: float = BEYOND_LIMITS
) -> dict[str, str]:
    """Joints that positions of a log `(N, n)` take so far beyond their limits, and where to."""
    found = {}
    for joint, (low, high) in zip(robot.coordinates, reach_of(values, q).tolist(), strict=True):
        if low < joint.limits.lower - least or high > joint.limits.upper + least:
            found[joint.name] = (
                f"{low:.2f} to {high:.2f} {joint.unit}, and its limits are "
                f"{joint.limits.lower:.3g} to {joint.limits.upper:.3g}"
            )
    return found


@dataclass(frozen=True, eq=False, repr=False)
class ActuatorModel:
    """A robot whose joints follow position targets, and the law of its actuators.

    Attributes:
        robot: The robot with the bodies of the model file, see `identified_robot`.
        signals: Columns of its logs.
        values: All parameters of the law, and signs of the log.
        free: What was searched.
        covariance: Of the search, `(p, p)`: logarithms where these were searched.
        known: Share of the prior's variance that the data took away, `(p,)`.
        wider: Factor of all intervals, so that fits to two halves of the motions agree; 1 if they
            do without one, `None` if they share no value that both show.
        scale: Scale of the residuals of each joint [rad; m].
        stated: Names of the parameters that the user stated.
        step: Length of the steps of rollouts [s].
        assumed: Joints whose stiffness nothing shows: it is like the others'.
        still: Joints that do not move in the fitted logs: nothing of them is identified.
        open_signs: Joints whose sign against the model file the fitted logs do not decide.
        beyond_limits: Joints that the motion of logs takes far beyond their limits.
        reach: Least and greatest positions of the motion, `(n, 2)`, in the model's joints.
        provenance: Inputs and settings.
        efforts: Torque per effort that is logged beside targets, by joint; empty without them.

    Example:
        >>> model = load_actuators("servo-model")
        >>> sorted(model.values.values)[:3]
        ['armature', 'back_emf', 'coulomb']
    """

    robot: Robot
    signals: TargetSignals
    values: ActuatorValues
    free: tuple[Free, ...]
    covariance: Array
    known: Array
    wider: float | None
    scale: Array
    stated: tuple[str, ...]
    step: float
    assumed: tuple[str, ...]
    still: tuple[str, ...]
    open_signs: tuple[str, ...]
    beyond_limits: tuple[str, ...]
    reach: Array
    provenance: Provenance
    efforts: tuple[EffortGain, ...] = ()

    def __repr__(self) -> str:
        return f"ActuatorModel({self.robot!r})"

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of all arrays."""
        return self.robot.joint_names

    @cached_property
    def arm(self) -> ArmStep:
        """The step of rollouts."""
        return arm_step(self.robot)

    @property
    def measured(self) -> tuple[str, ...]:
        """Joints whose torques have the scale of logged efforts."""
        searched = {self.joints[one.joint] for one in self.free if one.name == "stiffness"}
        return tuple(x.joint for x in self.efforts if x.status == "stated" and x.joint in searched)

    @property
    def masses_searched(self) -> bool:
        """Whether masses of links were searched too."""
        return any(one.name == "mass_factor" for one in self.free)

    @cached_property
    def identified_robot(self) -> Robot:
        """The robot with the masses that give all values their scale.

        Limits of its joints contain the motion of the logs.
        """
        joints = (
            replace(joint, limits=replace(limits, lower=min(limits.lower, low),
                                          upper=max(limits.upper, high)))
            for joint, (low, high) in zip(self.robot.coordinates, self.reach.tolist(), strict=True)
            for limits in [joint.limits]
        )  # fmt: skip
        bodies = (
            replace(body, inertia=Inertia.from_ten(body.inertia.ten * factor))
            for body in self.robot.bodies
            for factor in self.values["mass_factor"][[body.coordinate]]
        )
        return replace(self.robot, bodies=tuple(bodies), coordinates=tuple(joints))

    @cached_property
    def parameters(self) -> tuple[ActuatorParameter, ...]:
        """All parameters, joint by joint."""
        place = {(one.name, one.joint): k for k, one in enumerate(self.free)}
        found = []
        for kind in KINDS:
            common = kind.name == "delay" and np.ptp(self.values["delay"]) == 0.0
            by_joint = any(("delay", j) in place for j in range(self.robot.n))
            joints = [(-1, "all")] if common and not by_joint else list(enumerate(self.joints))
            for j, joint in joints:
                value = float(self.values[kind.name][j])
                at = place.get((kind.name, j))
                unit = _unit(kind.unit, self.robot, j)
                if at is None:
                    told = kind.name in self.stated
                    told &= not (joint in self.still and value == kind.default)
                    status = "stated" if told else "not in the law"
                    if status != "stated" and value != kind.default and kind.name != "zero":
                        status = "assumed"
                    found.append(ActuatorParameter(kind.name, joint, unit, value, None, status))
                    continue
                interval = self._interval(at, value)
                wide = kind.positive and self.covariance[at, at] > WIDE**2
                sure = self.known[at] > IDENTIFIED and not wide
                status = "identified" if sure else "not identifiable"
                if kind.name == "stiffness" and self.joints[j] in self.assumed:
                    status = "assumed"
                found.append(ActuatorParameter(kind.name, joint, unit, value, interval, status))
        return tuple(found)

    def _interval(self, at: int, value: float) -> tuple[float, float]:
        half, kind = Z95 * float(np.sqrt(self.covariance[at, at])), self.free[at].kind
        if kind.positive:
            # what an actuator may lack is zero, which no logarithm reaches
            least = max(1.0 - half, 0.0) if kind.default == 0.0 else float(np.exp(-half))
            return value * least, value * float(np.exp(half))
        low = value - half
        return (max(low, 0.0) if self.free[at].name == "delay" else low), value + half

    def outside_limits(self, q: Array) -> dict[str, str]:
        """Joints that positions of a log `(N, n)` take far beyond their limits, and where to."""
        return outside_limits(self.robot, self.values, q)

    def ratio(self, name: str, joint: int) -> tuple[float, float] | None:
        """A parameter over the stiffness of its joint, and the standard deviation of its logarithm.

        Ratios need no scale; `None` where the parameter was not searched.
        """
        place = {(one.name, one.joint): k for k, one in enumerate(self.free)}
        a, b = place.get((name, joint)), place.get(("stiffness", joint))
        if a is None or not BY_NAME[name].positive:
            return None
        c = self.covariance
        variance = float(c[a, a])
        if b is not None:
            variance += float(c[b, b] - 2.0 * c[a, b])
        value = float(self.values[name][joint] / self.values["stiffness"][joint])
        return value, float(np.sqrt(max(variance, 0.0)))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return {
            "schema": SCHEMA,
            "schema_version": SCHEMA_VERSION,
            "robot": robot_to_dict(self.robot),
            "signals": json_values(self.signals),
            "signs": self.values.signs.tolist(),
            "values": {name: x.tolist() for name, x in self.values.values.items()},
            "free": [[one.name, one.joint] for one in self.free],
            "covariance": self.covariance.tolist(),
            "known": self.known.tolist(),
            "wider": self.wider,
            "scale": self.scale.tolist(),
            "stated": list(self.stated),
            "step_s": self.step,
            **{name: list(getattr(self, name)) for name in OF_JOINTS},
            "reach": self.reach.tolist(),
            "efforts": [one.to_dict() for one in self.efforts],
            "provenance": json_values(self.provenance),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "ActuatorModel":
        """The model that `to_dict` wrote."""
        robot, origin = robot_from_dict(data["robot"]), data["provenance"]
        n, p = robot.n, len(data["free"])
        signs = frozen(data["signs"], (n,))
        lacking = {kind.name: [kind.default] * n for kind in KINDS if kind.name in LATER}
        given = {k.name: frozen({**lacking, **data["values"]}[k.name], (n,)) for k in KINDS}
        if not (abs(signs) == 1.0).all():
            raise ValueError("a sign is not 1 or -1")
        for kind in KINDS:
            x = given[kind.name]
            least = 1e-12 if kind.name in POSITIVE else 0.0
            low = (kind.positive or kind.name == "delay") and (x < least).any()
            if not (np.abs(x) <= UNLIMITED).all() or low:
                raise ValueError(f"'{kind.name}' is not finite, or not what an actuator can have")
        step = float(data["step_s"])
        if not LEAST_STEP <= step <= MOST_STEP:
            raise ValueError(
                f"steps of {step:g} s are not between {LEAST_STEP:g} and {MOST_STEP:g}"
            )
        free = tuple(Free(str(name), int(joint)) for name, joint in data["free"])
        if strange := [one for one in free if one.name not in BY_NAME or not -1 <= one.joint < n]:
            raise ValueError(
                f"there is no parameter '{strange[0].name}' of joint {strange[0].joint}"
            )
        if len(set(free)) < p or any(one.joint < 0 and one.name != "delay" for one in free):
            raise ValueError("'free' holds a parameter twice, or one of no joint")
        if not set(map(str, data["stated"])) <= set(BY_NAME):
            raise ValueError("'stated' holds a name that no parameter has")
        if Free("delay", -1) in free and np.ptp(given["delay"]) > 0.0:
            raise ValueError("the delay of all joints is not one value")
        if p > len(KINDS) * n or given["delay"].max(initial=0.0) > LONGEST_DELAY:
            raise ValueError("it holds more parameters, or a longer delay, than an arm can have")
        variance = np.diag(np.asarray(data["covariance"], dtype=float).reshape(p, p))
        if (variance < 0.0).any() or (variance > MOST_VARIANCE).any():
            raise ValueError("'covariance' has a variance that no value has")
        for name in ("covariance", "known", "scale", *(["reach"] * ("reach" in data))):
            if not np.isfinite(np.asarray(data[name], dtype=float)).all():
                raise ValueError(f"'{name}' holds a value that is not finite")
        lists = {name: tuple(origin.get(name, ())) for name in ("runs", "notes", "doubts")}
        for name in OF_JOINTS:
            if not isinstance(data[name], list) or not set(data[name]) <= set(robot.joint_names):
                raise ValueError(f"'{name}' is no list of joints")
        wider = data["wider"]
        if isinstance(wider, bool) or not (wider is None or 1.0 <= wider < np.inf):
            raise ValueError("'wider' is no factor of intervals")
        assumed, still, open_signs, beyond_limits = (tuple(data[x]) for x in OF_JOINTS)
        return cls(
            robot,
            TargetSignals.from_dict(data["signals"]),
            ActuatorValues(given, signs),
            free,
            frozen(data["covariance"], (p, p)),
            frozen(data["known"], (p,)),
            None if wider is None else float(wider),
            frozen(data["scale"], (n,)),
            tuple(map(str, data["stated"])),
            step,
            assumed,
            still,
            open_signs,
            beyond_limits,
            frozen(data.get("reach", [[np.inf, -np.inf]] * n), (n, 2)),
            Provenance(**{**origin, "inputs": dict(origin["inputs"]), **lists}),
            gains_from(data.get("efforts", ()), robot.joint_names),
        )

    def text(self) -> str:
        """The content of `model.json`."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"


def _unit(unit: str, robot: Robot, joint: int) -> str:
    """The unit of a parameter at a joint, which may be prismatic."""
    if joint < 0 or robot.coordinates[joint].kind == "revolute":
        return unit
    return (
        unit.replace("Nm/rad", "N/m")
        .replace("Nm s/rad", "N s/m")
        .replace("Nm", "N")
        .replace("kg m²", "kg")
        .replace("rad", "m")
    )


def arm_step(robot: Robot) -> ArmStep:
    """The step of a robot with the bodies of its model file.

    Raises:
        ModelError: It has closed chains, or bodies that are not known.
    """
    if robot.loops:
        raise ModelError(
            "the robot has closed chains, for which actuators are not identified from targets",
            where=f"robot '{robot.name}'",
            fix="log efforts; or lock the joints of the chain",
        )
    model = Model(robot, (RigidBody(),))
    nominal = model.prior
    if nominal is None:
        raise ModelError(
            "the model file has no masses, and targets and positions alone show no scale of torque",
            where=f"robot '{robot.name}'",
            fix="give a model file whose links have masses and inertias",
        )
    return ArmStep(model, nominal.values.values)


def is_actuator_model(path: str | Path) -> bool:
    """Whether a file, or the folder that contains it, is a model of actuators."""
    file = Path(path)
    file = file / "model.json" if file.is_dir() else file
    try:
        with file.open(encoding="utf-8") as text:
            head = text.read(200)
    except (OSError, ValueError):
        return False
    return f'"{SCHEMA}"' in head


def load_actuators(path: "str | Path | ActuatorModel") -> ActuatorModel:
    """Read `model.json` of identified actuators, or the folder that contains it.

    Raises:
        ModelError: It is missing, no model of actuators, or of another version.

    Example:
        >>> load_actuators("servo-model").joints
        ('shoulder', 'elbow')
    """
    if isinstance(path, ActuatorModel):
        return path
    file = Path(path)
    file = file / "model.json" if file.is_dir() else file
    fix = "give the model.json, or the folder, that `steelyard identify` wrote from targets"

    def parse(data: Any) -> ActuatorModel:
        if not isinstance(data, dict) or data.get("schema") != SCHEMA:
            raise ModelError("the file is no model of actuators", where=str(file), fix=fix)
        if data.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(
                f"the model has schema version {data.get('schema_version')}, not {SCHEMA_VERSION}",
                where=str(file),
                fix="identify again with this version of steelyard",
            )
        return ActuatorModel.from_dict(data)

    damaged = "the model is incomplete or damaged"
    return read_json(file, parse, what="the model", damaged=damaged, fix=fix)

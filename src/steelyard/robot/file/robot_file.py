"""Robot files: a model in any format, and with TOML all that a model file cannot say."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.checked_arguments import checked as checked_arguments
from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.robot import robot_from_mechanism as reduction
from steelyard.robot.file import model_reading_and_loaded_robot as reading
from steelyard.robot.file.base_signals_from_tables import build_base_signals, with_base
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot as LoadedRobot
from steelyard.robot.file.sections import (
    RobotFile,
    RobotSection,
    SignalsSection,
    TransmissionSection,
)
from steelyard.robot.file.signals import WITHOUT_TORQUE, Signals
from steelyard.robot.file.signals_from_tables import Locate, build_signals, build_target_signals
from steelyard.robot.file.toml_schema import checked
from steelyard.robot.floating_ball_and_coupled_joints import floating_base
from steelyard.robot.inertia_and_placement import clean_rotation, rpy_rotation
from steelyard.robot.loop_closures import Closing
from steelyard.robot.mechanism import Answer, Mechanism, Pin
from steelyard.robot.models.xacro import joined_reference, split_reference
from steelyard.robot.models.xml_and_urdf import read_bytes
from steelyard.robot.robot import FLOATING, Limits, Robot, Transmission, refuse_floating

WORST = 1e8  # condition number, rows scaled, from which on a matrix counts as singular


def build_transmission(
    section: TransmissionSection, joints: Sequence[str], locate: Locate
) -> Transmission:
    """The gears between motors and the identified joints, as the robot file declares them."""
    motors = section.motors or tuple(f"motor_{k + 1}" for k in range(len(joints)))
    if len(motors) != len(joints):
        raise ModelError(
            f"{len(motors)} motors are named for {len(joints)} joints",
            where=locate("robot", "transmission", "motors"),
            fix=f"name one motor per joint: {', '.join(joints)}",
        )
    for motor in motors:
        twice = motors.count(motor) > 1
        if twice or motor in joints:
            other = "another one, so that terms can say which of the two they mean"
            raise ModelError(
                f"two motors are called '{motor}'"
                if twice
                else f"motor '{motor}' has the name of a joint",
                where=locate("robot", "transmission", "motors"),
                fix="give every motor a name of its own" if twice else f"give it {other}",
            )
    matrix = _matrix(section, motors, joints, locate)
    lengths = np.linalg.norm(matrix, axis=1)
    scaled = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    if not lengths.all() or np.linalg.cond(scaled) > WORST:
        raise ModelError(
            "the transmission cannot be inverted: " + _why(scaled, motors),
            where=locate("robot", "transmission"),
            fix="every motor must turn some joint, and no combination of joints may leave all "
            "motors at rest: check ratios, coupling and matrix",
        )
    return Transmission(motors, matrix)


VELOCITIES_UNUSED = (
    "velocity columns are not used: with a floating base positions are differentiated"
)


def _check_base(file: RobotFile, robot: Robot, locate: Locate) -> None:
    """Logs of a floating robot have the motion of its base, those of others have none."""
    if file.signals is None:
        return
    given = file.signals.base is not None
    if given != robot.floating:
        raise ModelError(
            "the motion of a base is given, and the base is at rest"
            if given
            else "the base floats, and its motion is not given",
            where=locate("signals", "base") if given else locate("signals"),
            fix=f'write base = "{FLOATING}" under [robot], or remove [signals.base]'
            if given
            else 'add [signals.base] with acceleration = "acc_{}" and angular_velocity = "gyro_{}" '
            "of an inertial sensor, or position and orientation of motion capture",
        )
    compensated = file.signals.effort.kind == "gravity_compensated_torque"
    if given and (compensated or file.processing.repetitions is not None):
        what = "gravity compensated efforts" if compensated else "repetitions of a motion"
        raise ModelError(
            f"{what} are not possible with a floating base",
            where=locate("signals", "effort") if compensated else locate("processing"),
            fix="log torques that carry the weight"
            if compensated
            else "remove repetitions: all samples are fitted",
        )


def _signals(section: SignalsSection, robot: Robot, locate: Locate) -> Signals:
    """The signals of all coordinates, those of a floating base included."""
    gears, n = robot.transmission, robot.n_base
    if gears is not None and n:
        gears = Transmission(gears.motors[n:], gears.matrix[n:, n:])
    signals = build_signals(section, robot.coordinates[n:], locate, gears)
    if section.base is None:
        return signals
    return with_base(signals, build_base_signals(section.base, robot, locate), locate)


def _beside_base(gears: Transmission, robot: Robot) -> Transmission:
    """The gears of a robot's joints, and of its base, if it floats, those that change nothing."""
    n = robot.n_base
    matrix = np.eye(robot.n)
    matrix[n:, n:] = gears.matrix
    return Transmission((*robot.joint_names[:n], *gears.motors), matrix)


def _matrix(
    section: TransmissionSection, motors: Sequence[str], joints: Sequence[str], locate: Locate
) -> Array:
    if (section.ratios is None) == (section.matrix is None):
        raise ModelError(
            "a transmission has ratios or a matrix, one of them",
            where=locate("robot", "transmission"),
            fix="give ratios = [...] (and coupling = [...]), or matrix = [[...], ...]",
        )
    n = len(joints)
    if section.matrix is not None:
        if len(section.matrix) != n or any(len(row) != n for row in section.matrix):
            raise ModelError(
                f"the transmission matrix is not {n} x {n}",
                where=locate("robot", "transmission", "matrix"),
                fix="give one row per motor with one ratio per identified joint",
            )
        matrix = np.array(section.matrix, dtype=np.float64)
    else:
        ratios = section.ratios or ()
        if len(ratios) != n:
            raise ModelError(
                f"{len(ratios)} ratios are given for {n} joints",
                where=locate("robot", "transmission", "ratios"),
                fix="give one ratio per identified joint, in the joints' order",
            )
        matrix = np.diag(np.array(ratios, dtype=np.float64))
    for index, coupling in enumerate(section.coupling):
        where = locate("robot", "transmission", "coupling", index)
        for name, names, kind in (
            (coupling.motor, motors, "motors"),
            (coupling.joint, joints, "joints"),
        ):
            refuse_unknown(name, names, f"'{name}' is none of the robot's {kind}", where, kind)
        matrix[motors.index(coupling.motor), joints.index(coupling.joint)] += coupling.ratio
    return matrix


def _why(scaled: Array, motors: Sequence[str]) -> str:
    idle = [m for m, row in zip(motors, scaled, strict=True) if not row.any()]
    if idle:
        return f"'{idle[0]}' turns no joint"
    weights = np.abs(np.linalg.svd(scaled.T)[2][-1])
    together = [m for m, w in zip(motors, weights, strict=True) if w > 1e-6]
    return f"{', '.join(together)} turn with the same combinations of joints"


def closing_of(section: RobotSection, mechanism: Mechanism, locate: Locate) -> Closing:
    """The closed chains of a robot file."""
    names = [link.name for link in mechanism.links]
    pins: list[Pin] = []
    for index, loop in enumerate(section.loops):
        for end, link in enumerate(loop.links):
            _check_name("link", link, names, locate("robot", "loops", index, "links", end))
        name, where = loop.name or f"loop{index + 1}", locate("robot", "loops", index)
        if any(pin.name == name for pin in (*mechanism.pins, *pins)):
            raise ModelError(
                f"two loops have the name '{name}'",
                where=where,
                fix="give every loop a name of its own",
            )
        pins.append(Pin(name, loop.links, frozen(loop.points), where))
    return Closing(
        tuple(pins), section.passive, section.assembly, section.open_loops, locate("robot")
    )


STANDARD_GRAVITY = 9.81
LEAST_GRAVITY, LARGEST_GRAVITY = 1.0, 30.0
"""Sizes of gravity [m/s²] between which it may be that of a planet or a moon."""


@checked_arguments()
def load_robot(
    path: str | Path | LoadedRobot, text: str | None = None, *, base: str | None = None
) -> LoadedRobot:
    """The robot of a URDF, a xacro file, an MJCF or a robot file (TOML), distinguished by content.

    Args:
        path: The file; of a xacro file with its arguments: `arm.urdf.xacro name:=left`. A robot
            that is loaded already is returned as it is.
        text: What a robot file at `path` would hold; that file is then not read, and need not be
            there.
        base: The link of a URDF or MJCF that is fixed to the world; `None` is its root. With
            `"floating"` none is: the root of a URDF, or the link of a free joint, is the base of a
            robot that stands, walks or flies. A robot file says so itself.

    Raises:
        ModelError: The file cannot be used.

    Example:
        >>> load_robot("arm.toml").stem
        'arm'
    """
    if isinstance(path, LoadedRobot):
        if text is None and base is None:
            return path
        path = path.reference
    if base is not None and Path(path).suffix.lower() == ".toml":
        raise ModelError(
            f"the base '{base}' is given beside a robot file",
            where=str(path),
            fix=f'write base = "{base}" under [robot] there',
        )
    if text is not None:
        return _from_toml(Path(path), text, reading.sha256_of(text.encode()))
    path, arguments = split_reference(path)
    if path.suffix.lower() == ".toml":
        if arguments:
            raise ModelError(
                "arguments stand behind a robot file",
                where=joined_reference(path, arguments),
                fix="write them into it: [robot.xacro] arguments = {NAME = VALUE}",
            )
        return _from_toml(path, robot_text(path), reading.source_of(path).sha256)
    return reading.robot_of_model(reading.read_model(path, arguments), base=base)


def robot_text(path: Path) -> str:
    """The text of a robot file, its lines ended by newlines."""
    try:
        text = read_bytes(path, "a robot file (.toml), a URDF or an MJCF").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ModelError(
            f"the robot file is not UTF-8 text: {error.reason} at byte {error.start}",
            where=str(path),
            fix="save it as UTF-8",
        ) from None
    return text.replace("\r\n", "\n")


def _from_toml(path: Path, text: str, sha256: str) -> LoadedRobot:
    file, locate = checked(path, text, RobotFile)
    model = reading.model_of_tables(file.robot, path, locate)
    mechanism = model.mechanism
    robot, notes = _reduced(mechanism, file.robot, locate)
    notes = model.notes + notes
    if file.robot.transmission is not None:
        joints = robot.joint_names[robot.n_base :]
        gears = build_transmission(file.robot.transmission, joints, locate)
        robot = robot.changed(transmission=_beside_base(gears, robot))
    _check_base(file, robot, locate)
    signals = None
    targets = None
    described = "actuator" in file.model_fields_set
    alone = file.signals is not None and (described or not file.signals.has_efforts)
    if file.signals is not None and file.signals.target and alone:
        refuse_floating(robot, "the identification of actuators")
        _refuse_of_efforts(file, locate)
        targets = build_target_signals(file.signals, robot.coordinates, locate, robot.transmission)
    elif file.signals is not None:
        signals = _signals(file.signals, robot, locate)
        notes += (VELOCITIES_UNUSED,) if robot.floating and file.signals.velocity else ()
    if targets is None and described:
        raise ModelError(
            "actuators are described, but no position targets",
            where=locate("actuator"),
            fix="add target = ... under [signals]; or remove [actuator]",
        )
    limited = {n for n, limits in file.robot.limits.items() if limits.effort is not None}
    ignored = reduction.ignored_statements(mechanism, robot, _answers(file), limited)
    notes += tuple(ignored.values())
    if signals is not None and signals.effort_kind == "gravity_compensated_torque":
        robot = robot.changed(gravity=np.zeros(3))
        notes += ("efforts are gravity compensated: the model has none either",)
    if signals is not None and signals.effort_map is None and not any(signals.unknown_gains):
        no_torques = [unit for unit in signals.effort_units if unit in WITHOUT_TORQUE]
        if no_torques and np.all(signals.gains == 1.0):
            notes += (
                "all drive gains are 1: parameters are correct only if 1 "
                f"{no_torques[0]} corresponds to 1 Nm",
            )
    return LoadedRobot(
        robot,
        notes,
        signals,
        _terms(file, locate),
        None if file.model is None else file.model.friction,
        file.processing,
        file.estimation,
        file.validation,
        (reading.SourceFile(path, sha256), *model.sources),
        locate,
        file.prior,
        file.knowledge,
        file.excitation,
        reduction.springs_along(mechanism, robot),
        ignored,
        base=file.robot.base,
        floats=floating_base(mechanism, file.robot.base) is not None,
        couplings_stated=file.robot.transmission is None
        or file.robot.transmission.couplings_stated,
        targets=targets,
        actuator=file.actuator,
    )


def _refuse_of_efforts(file: RobotFile, locate: Locate) -> None:
    """What only efforts make sense of is refused where actuators are identified, not ignored."""
    names = ("model", "processing", "estimation", "prior", "validation")
    given = [(name, getattr(file, name)) for name in names]
    used = [name for name, x in given if x is not None and x.model_fields_set]
    used += ["knowledge"] if file.knowledge else []
    if used:
        told = ", ".join(f"[{name}]" if name in names else f"[[{name}]]" for name in used)
        other = "remove [actuator]" if file.signals and file.signals.has_efforts else ""
        raise ModelError(
            f"{told} {'is' if len(used) == 1 else 'are'} for identification from efforts, not of "
            "actuators",
            where=locate(used[0]),
            fix=f"remove {told}; or {other or 'add [signals.effort]'}, to identify from efforts",
        )


def _answers(file: RobotFile) -> set[Answer]:
    """What the robot file says where the model file is not followed."""
    answers: set[Answer] = set()
    if file.robot.gravity is not None or file.robot.mounting is not None:
        answers.add("gravity")
    if file.signals is not None and file.signals.effort.kind == "gravity_compensated_torque":
        answers |= {"gravity", "weight"}
    terms = () if file.model is None or file.model.terms is None else file.model.terms
    if "spring" in [term if isinstance(term, str) else term.get("law") for term in terms]:
        answers.add("springs")
    return answers


def _reduced(
    mechanism: Mechanism, section: RobotSection, locate: Locate
) -> tuple[Robot, tuple[str, ...]]:
    movable = [j.name for j in mechanism.movable]
    balls = [j.name for j in mechanism.joints if j.kind == "ball"]
    for table in ("locked", "limits", "assembly"):
        known = [*movable, *balls] if table == "locked" else movable
        for name in getattr(section, table):
            _check_name("joint", name, known, locate("robot", table, name))
    for key in ("joints", "passive"):
        for index, name in enumerate(getattr(section, key) or ()):
            _check_name("joint", name, movable, locate("robot", key, index))
            again = name in (getattr(section, key) or ())[:index]
            if again or name in section.locked:
                how = "listed twice" if again else "locked, but also listed"
                raise ModelError(
                    f"joint '{name}' is {how} under {key}",
                    where=locate("robot", key, index),
                    fix="list every joint once: under joints, passive or locked",
                )
    links = [link.name for link in mechanism.links]
    tips = (section.tip,) if isinstance(section.tip, str) else section.tip or ()
    for key, name in [("tip", t) for t in tips] + [("base", section.base or mechanism.root)]:
        known = [*links, FLOATING] if key == "base" else links
        _check_name("link", name, known, locate("robot", key))
    robot, notes = reduction.reduced(
        mechanism,
        section.joints,
        locked=section.locked,
        base=section.base,
        tip=section.tip,
        gravity=_gravity(section, locate),
        limits={n: _limits(n, mechanism, section, locate) for n in section.limits},
        closing=closing_of(section, mechanism, locate),
        snap=section.snap_angles,
    )
    if section.name is not None:
        robot = robot.changed(name=section.name)
    if robot.floating and section.mounting is not None:
        raise ModelError(
            "a mounting is given, and the base floats",
            where=locate("robot", "mounting"),
            fix="remove it: the log has the orientation of a floating base",
        )
    return robot, notes


def _check_name(kind: str, name: str, names: list[str], where: str) -> None:
    moving = " that moves on its own" if kind == "joint" else ""
    wrong = f"the model has no {kind} '{name}'{moving}"
    refuse_unknown(name, names, wrong, where, f"{kind}s")


def _limits(name: str, mechanism: Mechanism, section: RobotSection, locate: Locate) -> Limits:
    given = section.limits[name].model_dump(exclude_none=True)
    limits = replace(reduction.unlimited_if_empty(mechanism.joint(name).limits), **given)
    if limits.lower >= limits.upper:
        raise ModelError(
            f"joint '{name}' has a lower limit of {limits.lower:g} and an upper one of "
            f"{limits.upper:g}",
            where=locate("robot", "limits", name),
            fix="the upper limit must be above the lower one",
        )
    return limits


def _gravity(section: RobotSection, locate: Locate) -> Array | None:
    """Gravity in the base frame, if the file says anything about it."""
    size = float(np.linalg.norm(section.gravity or 0.0))
    if section.mounting is None and size > 0.0 and not LEAST_GRAVITY <= size <= LARGEST_GRAVITY:
        raise ModelError(
            f"gravity has a size of {size:.4g} m/s²",
            where=locate("robot", "gravity"),
            fix="give it in m/s² along the axes of the base frame, such as [0.0, 0.0, -9.81]; "
            "[0.0, 0.0, 0.0] for none",
        )
    if section.mounting is None:
        return None if section.gravity is None else np.array(section.gravity)
    if section.gravity is not None:
        raise ModelError(
            "gravity and mounting are both given",
            where=locate("robot", "gravity"),
            fix="keep one of them: gravity is the vector in the base frame, mounting its rotation",
        )
    mounting = section.mounting
    rotation = rpy_rotation(*np.deg2rad([mounting.roll, mounting.pitch, mounting.yaw]))
    return frozen(clean_rotation(rotation)[2] * -STANDARD_GRAVITY + 0.0)


def _terms(file: RobotFile, locate: Locate) -> tuple[reading.TermSpec, ...] | None:
    if file.model is None or file.model.terms is None:
        return None
    specs = []
    for index, term in enumerate(file.model.terms):
        where = locate("model", "terms", index)
        if not isinstance(term, str) and not isinstance(term.get("law"), str):
            raise ModelError(
                "a term's table does not name its law",
                where=where,
                fix='write {law = "coulomb", ...}',
            )
        specs.append(
            reading.TermSpec(term if isinstance(term, str) else MappingProxyType(term), where)
        )
    return tuple(specs)

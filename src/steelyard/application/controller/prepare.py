"""What of an identified model a controller needs, and models that no controller can use."""

from collections.abc import Sequence

from steelyard.application.controller.functions import (
    FUNCTIONS,
    OBSERVER,
    OF_ALL_TERMS,
    USUAL,
    Controller,
    ObserverNumbers,
)
from steelyard.errors import DataError, ModelError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.estimation.residual_peaks import FEWEST
from steelyard.kernel.quantities.kinematics import frame_of
from steelyard.robot.robot import Robot
from steelyard.suggest import advice
from steelyard.validation.headline import known_efforts
from steelyard.validation.residual_traces import sliding_friction, supported_rate


def controller_of(
    identified: IdentifiedModel, functions: Sequence[str] = (), frames: Sequence[str] = ()
) -> Controller:
    """The model with what is wanted of it.

    Args:
        identified: The model.
        functions: Names of `FUNCTIONS`, or `OBSERVER`; the usual ones if empty.
        frames: Names of frames whose pose and Jacobian are wanted; if empty, the last frame on
            every link that carries no other.

    Raises:
        ModelError: Its efforts are known up to a scale only or lack the weight; or there is no
            such frame.
        DataError: There is no such function.
    """
    _refuse_unusable(identified)
    robot = identified.model.robot
    known = (*FUNCTIONS, OBSERVER)
    for name in functions:
        if name not in known:
            raise DataError(
                f"there is no function '{name}'",
                where="--function",
                fix=advice(name, known, "functions"),
            )
    for frame in frames:
        frame_of(robot, frame)
    wanted = tuple(name for name in dict.fromkeys(functions) if name != OBSERVER)
    chosen = tuple(dict.fromkeys(frames)) or end_frames(robot)
    return Controller(
        identified.model,
        identified.valued.values,
        wanted or (() if functions else USUAL),
        chosen,
        observer_of(identified) if OBSERVER in functions else None,
    )


def observer_of(identified: IdentifiedModel) -> ObserverNumbers:
    """The usual bandwidth, and thresholds from left-out motion if the model has enough of it.

    They are those of 1 false alarm per hour, or as few as that motion supports.
    """
    calibration = identified.calibration
    peaks = None if calibration is None else calibration.peaks
    if peaks is None or not (peaks.visits >= FEWEST).any():
        return ObserverNumbers(identified.cutoffs.score, None)
    friction = sliding_friction(identified, peaks.edges[:, 1])
    return ObserverNumbers(peaks.cutoff, peaks.thresholds(supported_rate(peaks, None), friction))


def end_frames(robot: Robot) -> tuple[str, ...]:
    """Per link that carries no other its last frame, or its own."""
    parents = {body.parent for body in robot.bodies}
    ends = [k for k in range(len(robot.bodies)) if k not in parents]
    last = {frame.body: frame.name for frame in robot.frames}
    return tuple(last.get(k, robot.bodies[k].name) for k in ends)


def absent(controller: Controller) -> tuple[str, ...]:
    """Functions that are wanted but need the memory of friction."""
    return tuple(n for n in controller.names if controller.n_memory and n in OF_ALL_TERMS)


def origin_of(identified: IdentifiedModel) -> tuple[str, ...]:
    """Where the numbers come from, for heads of files."""
    origin, kind = identified.provenance, identified.signals.effort_kind
    lines = [
        f"Identified with steelyard {origin.version}, estimate: {identified.estimate.estimator}.",
        f"Runs: {', '.join(origin.runs) or 'unknown'}.",
        *(f"  {role}: sha256 {value}" for role, value in origin.inputs.items()),
    ]
    if kind == "link_torque":
        lines += [
            "Efforts are those on the link side, where they were measured: the controller has to",
            "add the friction of motors and gears.",
        ]
    else:
        lines.append("Efforts are those at the joints that move the robot, friction included.")
    if identified.effort_scales is not None:
        factors = identified.effort_scales.words
        lines.append(f"Logged efforts are {factors} times as large (estimated effort scales).")
    return tuple(lines)


def _refuse_unusable(identified: IdentifiedModel) -> None:
    signals, robot = identified.signals, identified.model.robot
    known = known_efforts(identified)
    unknown = signals.unknown_gains or (False,) * len(known)
    for joint, sure, lacking in zip(robot.joint_names, known, unknown, strict=True):
        if lacking or not sure:
            raise ModelError(
                f"the drive gain of joint '{joint}' is unknown: efforts of the model are no Nm",
                where=f"model of '{robot.name}', [signals.effort] gain",
                fix="identify again with the gains in Nm/A, or with a payload of known mass "
                "(--loaded, --payload-mass), which fixes their scale",
            )
    if signals.effort_kind == "gravity_compensated_torque":
        raise ModelError(
            "the model lacks the weight: it was identified from gravity-compensated efforts",
            where=f"model of '{robot.name}', [signals.effort] kind",
            fix="identify from efforts that include the weight, such as motor currents or "
            "measured joint torques",
        )

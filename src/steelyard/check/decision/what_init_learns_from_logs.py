"""What `init` writes from logs: drive gains, friction laws and gears."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.check.case_logs_and_checks import CheckedLog
from steelyard.check.decision.controller_gains_and_gain_advice import gains_of_logs
from steelyard.check.hypotheses.log_excerpt import Excerpt, excerpt_of
from steelyard.estimate.friction.friction_mixes_and_curves import joint_motions, lacking
from steelyard.logs.formats import open_log
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.signals import Signals, expanded
from steelyard.robot.file.signals_from_tables import build_signals
from steelyard.robot.init.draft_tables import Known, needs_gains
from steelyard.robot.init.guess_columns import Guess
from steelyard.robot.init.guess_efforts_and_gears import Gears
from steelyard.robot.robot import Coordinate, Transmission
from steelyard.runs.processing_choices import Processing
from steelyard.runs.runs_of_named_logs import LogArgument, recording_of


def refuse_other_columns(
    logs: Sequence[LogArgument], guess: Guess, moving: Sequence[Coordinate]
) -> None:
    """Raise `LogError` where a log lacks columns of the first."""
    section = guess.section
    listed = [section.position, section.velocity or (), section.effort.columns]
    each = [expanded(names, moving) if isinstance(names, str) else names for names in listed]
    for log in logs[1:]:
        columns = open_log(log.path).columns
        if missing := [name for names in each for name in names if name not in columns]:
            raise LogError(
                f"the log lacks columns of the first log: {', '.join(missing)}",
                where=str(log.path),
                fix=f"give logs with the columns of {logs[0].path}, and one robot file per layout",
            )


def known_from_logs(
    loaded: LoadedRobot,
    moving: Sequence[Coordinate],
    logs: Sequence[LogArgument],
    guess: Guess,
    gears: Gears | None,
) -> Known:
    """Gains from the controller's own targets, and whether friction laws can be chosen."""
    if guess.motor_side and gears is None:
        return Known(friction="the gear ratios are unknown")
    signals = _signals(guess, moving, gears)
    checked = [CheckedLog(recording_of(log, signals), Processing(), log.text) for log in logs]
    excerpts = [x for e in checked if (x := excerpt_of(e.recording, e.processing)) is not None]
    auto, friction = _friction(excerpts, signals, moving)
    found = gains_of_logs(checked, len(moving)) if needs_gains(guess) else None
    if found is None:
        reference = _heaviest(loaded, moving, excerpts, signals) if needs_gains(guess) else 0
        return Known(reference=reference, auto=auto, friction=friction)
    source = (
        f"the controller's target torque over its target current ({found.columns[0]} over "
        f"{found.columns[1]}, ..., friction fitted beside it; 95 %): "
        f"{found.words([c.name for c in moving])}"
    )
    return Known(gains=tuple(found.entries), gains_source=source, auto=auto, friction=friction)


def _signals(guess: Guess, moving: Sequence[Coordinate], gears: Gears | None) -> Signals:
    """The guessed signals; gains of currents are left to be identified."""
    section = guess.section
    if needs_gains(guess):
        effort = section.effort.model_copy(update={"gain": "identify"})
        section = section.model_copy(update={"effort": effort})
    transmission = None
    if gears is not None:
        matrix = np.diag(gears.ratios)
        for motor, joint, ratio in gears.coupling:
            matrix[motor, joint] += ratio
        names = tuple(f"motor_{k + 1}" for k in range(len(moving)))
        transmission = Transmission(names, matrix)
    return build_signals(section, moving, lambda *key: "the log's columns as guessed", transmission)


def _friction(
    excerpts: Sequence[Excerpt], signals: Signals, moving: Sequence[Coordinate]
) -> tuple[bool, str]:
    """Whether `friction = "auto"` is of use, and why."""
    if not excerpts:
        return False, "no motion could be read"
    logs = [(_joints(x.dz, signals), x.stretch, 1.0 / x.rate) for x in excerpts]
    motions = joint_motions(logs)
    missing = lacking(motions, moving)
    if missing:
        more = f", and so on for {len(missing) - 1} more" if len(missing) > 1 else ""
        return False, missing[0] + more
    fewest = min(motion.reversals for motion in motions)
    return True, f"every joint reverses, {fewest} times or more, and moves at several speeds"


def _joints(columns: Array, signals: Signals) -> Array:
    """Position columns as logged, or their derivatives, as the joints', shape `(n, B)`."""
    scaled = signals.position_scale[:, None] * columns
    return scaled if signals.position_map is None else np.asarray(signals.position_map @ scaled)


def _heaviest(
    loaded: LoadedRobot, moving: Sequence[Coordinate], excerpts: Sequence[Excerpt], signals: Signals
) -> int:
    """The joint whose nominal gravity effort varies most along the logs."""
    robot = loaded.robot
    nominal = Model(robot, (RigidBody(),)).prior
    if not excerpts or nominal is None:
        return 0
    q = np.zeros((sum(len(x.t) for x in excerpts), robot.n))
    places = [robot.joint_names.index(c.name) for c in moving]
    q[:, places] = np.concatenate([_joints(x.z, signals) for x in excerpts], axis=1).T
    return int(np.argmax(nominal.gravity(q)[:, places].std(axis=0)))

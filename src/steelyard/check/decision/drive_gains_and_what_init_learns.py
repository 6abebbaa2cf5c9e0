r"""Drive gains by the controller's own targets, advice on gains, and what `init` learns from logs.

A controller that turns torques into currents has gains for it. In motion its target current also
compensates friction, which is any function of speed here, and accelerates rotors:

$$ i^* = \tau^* / K + f(\dot q) + I_r \ddot q $$

The target torque is the controller's own and exact; what this lacks is an error of the current, so
least squares of the current are not biased. Intervals come from leaving out one part of the time
after the other (jackknife).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, LogError, SteelyardError
from steelyard.check.cases_and_checks import Case, CheckedLog, remembered
from steelyard.check.finding import Edit, Finding, Fix, Severity
from steelyard.check.hypotheses.hypotheses_and_their_scores import Hypothesis
from steelyard.check.hypotheses.log_excerpt import Excerpt, excerpt_of
from steelyard.check.hypotheses.nuisance_fit_and_score import REST_SPEED
from steelyard.check.hypotheses.position_and_effort_hypotheses import FAR_GAIN, OTHER_GAIN_FACTOR
from steelyard.check.hypotheses.sensors_contacts_and_limbs import CONTACTS, SENSOR_MOUNTING
from steelyard.check.hypotheses.signs_and_delay_by_friction import NO_DELAY_ADVICE
from steelyard.estimate.friction.friction_mixes_and_curves import (
    joint_motions,
    lacking,
    with_any_speed,
)
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.payload.drive_gains import identified_gains
from steelyard.logs.formats import open_log
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.sections import Gain
from steelyard.robot.file.signals import Signals, expanded
from steelyard.robot.file.signals_from_tables import build_signals
from steelyard.robot.init.column_names import Column, by_number
from steelyard.robot.init.draft_tables import Known, needs_gains
from steelyard.robot.init.guess_columns import Guess
from steelyard.robot.init.guess_efforts_and_gears import Gears, stated_current
from steelyard.robot.robot import Coordinate, Transmission
from steelyard.runs.processing_choices import Processing
from steelyard.runs.runs_of_named_logs import LogArgument, recording_of

TARGET_WORDS = frozenset("des desired target ref reference cmd command commanded setpoint".split())
TORQUE_WORDS = frozenset("tau torque torques moment moments".split())
CURRENT_WORDS = frozenset("current currents curr i".split())
FRICTION_KNOTS = 24  # speeds between which friction is linear
INTERVAL_PARTS = 12  # parts of the time for intervals
LACKS_WEIGHT = (
    "find out which it is: masses and centres of the model file, a counterweight or spring that it "
    "lacks, or a controller that subtracts a computed weight: then log whole efforts, or add to "
    "them the gravity torque that the controller subtracts"
)
NARROW_INTERVAL = 0.05  # half-width of a gain's 95 % interval over it, to be written


@dataclass(frozen=True, eq=False)
class ControllerGains:
    """Gains with their intervals."""

    columns: tuple[str, str]  # those of target torque and target current of the first joint
    values: Array  # joint torque over current, shape `(n,)`; zero where it cannot be estimated
    half_widths: Array  # of 95 % intervals, shape `(n,)`

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where the interval is narrow, shape `(n,)`."""
        return np.asarray(self.half_widths <= NARROW_INTERVAL * self.values) & (self.values > 0.0)

    @property
    def entries(self) -> list[Gain]:
        """The robot file's `gain`: a number where it is known, else `"identify"`."""
        pairs = zip(self.values, self.known, strict=True)
        return [float(f"{value:.4g}") if known else "identify" for value, known in pairs]

    def words(self, names: Sequence[str]) -> str:
        """Gains that are known, with their intervals."""
        rows = zip(names, self.values, self.half_widths, self.known, strict=True)
        return ", ".join(f"{name} {g:.4g} ± {w:.2g}" for name, g, w, known in rows if known)


@remembered
def controller_gains(case: Case) -> ControllerGains | None:
    """Gains from all logs that have both targets; `None` where none is known."""
    return gains_of_logs(case.logs, len(case.joints))


def gains_of_logs(logs: Sequence[CheckedLog], joints: int) -> ControllerGains | None:
    """Gains from all logs that have both targets; `None` where none is known."""
    found = [part for log in logs if (part := _target_rows(log)) is not None]
    if not found:
        return None
    rows = [np.concatenate([own[j] for _, own in found], axis=1) for j in range(joints)]
    fits = np.array([_gain(one) for one in rows])
    gains = ControllerGains(found[-1][0], fits[:, 0], fits[:, 1])
    return gains if gains.known.any() else None


def _target_rows(log: CheckedLog) -> tuple[tuple[str, str], list[Array]] | None:
    """Names of both targets; per joint both, speed, acceleration, `(4, N)`; `None` without."""
    recording, signals = log.recording, log.recording.signals
    if set(signals.effort_units) != {"A"} or signals.effort_map is not None:
        return None
    named = [Column(name) for name in log.log.columns]
    targets = [column for column in named if TARGET_WORDS & set(column.words)]
    groups = [
        by_number(signals.n, [c for c in targets if words & set(c.words)])
        for words in (TORQUE_WORDS, CURRENT_WORDS)
    ]
    if not all(groups):
        return None
    columns = [tuple(column.name for column in group[0]) for group in groups]
    read = [replace(signals, effort=names, effort_scale=np.ones(signals.n)) for names in columns]
    same_rows = replace(log.processing, leave_out_saturated=False)  # all rows of both
    torque, current = (excerpt_of(replace(recording, signals=one), same_rows) for one in read)
    if torque is None or current is None:
        return None
    dq, ddq = (signals.position_scale[:, None] * x for x in (torque.dz, torque.ddz))
    moving = np.abs(dq) > REST_SPEED * np.quantile(np.abs(dq), 0.98, axis=1)[:, None]
    rows = np.stack((torque.e, current.e * signals.effort_scale[:, None], dq, ddq), axis=1)
    names = columns[0][0], columns[1][0]
    return names, [part[:, kept] for part, kept in zip(rows, moving, strict=True)]


def _gain(rows: Array) -> tuple[float, float]:
    """Gain of one joint and the half-width of its 95 % interval; zero where nothing shows it."""
    count = rows.shape[1]
    if count < 20 * FRICTION_KNOTS or not all(np.ptp(x) > 0.0 for x in rows[:2]):
        return 0.0, 0.0
    ends = np.linspace(0, count, INTERVAL_PARTS + 1).astype(int)
    parts = zip(ends[:-1], ends[1:], strict=True)
    left_out = np.array([_inverse(np.delete(rows, slice(a, b), axis=1)) for a, b in parts])
    inverse = _inverse(rows)
    std = np.sqrt(
        (INTERVAL_PARTS - 1) / INTERVAL_PARTS * np.sum(np.square(left_out - np.mean(left_out)))
    )
    if inverse <= 0.0:
        return 0.0, 0.0
    return 1.0 / inverse, float(2.0 * std / inverse**2)


def _inverse(rows: Array) -> float:
    """Target current over target torque, friction and rotor inertia beside it."""
    torque, current, speed, acceleration = rows
    knots = np.unique(np.append(np.quantile(speed, np.linspace(0.0, 1.0, FRICTION_KNOTS)), 0.0))
    hats = [np.interp(speed, knots, row) for row in np.eye(len(knots))]
    columns = np.array([torque, acceleration, *hats]).T
    lengths = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    found = np.linalg.lstsq(columns / lengths, current, rcond=1e-10)[0]
    return float(found[0] / lengths[0])


LEAST_GEAR_RATIO, LARGEST_GEAR_RATIO = 20.0, 500.0
"""Factor on all torques from which, and up to which, they may be those before gears."""


GO_ON = ". If the masses of the model file are wrong, continue: the efforts are then as declared"
CURRENT_UNITS = {"A": 1.0, "mA": 1e-3}  # units of current [A]
CAUSES_THAT_SCALE = ("gain", "effort kind", "effort unit")  # causes that are a factor on efforts


OF_FLOATING_BASE = {
    SENSOR_MOUNTING: (
        "state its mounting under [signals.base] from a drawing, as these angles are fitted by the "
        "masses of the model file, to a degree or two"
    ),
    CONTACTS: (
        "log forces of the world on the robot in newtons, upwards under a foot; no line of the "
        "robot file changes their sign or scale"
    ),
}
"""What to do about sensors and contacts of a floating base that no line corrects for certain."""


def unwritten_number_advice(case: Case, hypothesis: Hypothesis, *, sure: bool) -> Fix:
    """What to do about an explanation without numbers; `sure` if efforts are wrong."""
    if hypothesis.reading.held and hypothesis.cause == "effort kind":
        return Fix(LACKS_WEIGHT)
    if hypothesis.cause in CAUSES_THAT_SCALE:
        if unit := _of_names(case, hypothesis):
            return unit
        gains = controller_gains(case) if hypothesis.cause == "gain" else None
        if gains is not None:
            return _of_controller(case, gains)
        return Fix(_of_other_torques(case, hypothesis) + _listed_sources(case, sure=sure))
    if hypothesis.cause == "effort delay":
        return Fix(NO_DELAY_ADVICE)
    if hypothesis.cause in OF_FLOATING_BASE:
        return Fix(f"{hypothesis.says}: {OF_FLOATING_BASE[hypothesis.cause]}")
    other = {
        "mounting": (
            "an external force acts on the arm (a cable, a balancer), or lengths and axes differ "
            "from the model file: this log alone cannot decide"
        ),
        "payload": (
            "the link inertias differ from the model file: identify it with steelyard payload, "
            "against a model from runs known to be correct, or give that here (--model)"
        ),
    }.get(
        hypothesis.cause,
        "the link inertias differ from the model file: the log alone cannot decide; examine both, "
        "or give a model from runs known to be correct (--model)",
    )
    return Fix(f"{hypothesis.says}, or {other}")


def _of_names(case: Case, hypothesis: Hypothesis) -> Fix | None:
    """The unit of current that the columns' names state, where it is the factor on all efforts."""
    signals = case.loaded.signals
    if signals is None or set(signals.effort_units) != {"A"}:
        return None
    units = {stated_current(Column(name)) for name in signals.effort}
    if len(units) != 1 or not (unit := units.pop()):
        return None
    factors = np.abs(hypothesis.reading.effort_scale / signals.effort_scale)
    wanted = CURRENT_UNITS[unit] / np.abs(signals.effort_scale)
    if np.any(wanted == 1.0) or np.any(np.abs(np.log(factors / wanted)) > np.log(FAR_GAIN)):
        return None
    return Fix(
        f"the names of the effort columns state {unit}, and efforts are off by about that factor",
        (Edit(("signals", "effort", "unit"), unit),),
    )


def _of_other_torques(case: Case, hypothesis: Hypothesis) -> str:
    """The lines for torques in mNm, or of motors, where the factor on all efforts is near."""
    signals = case.loaded.signals
    if signals is None or "A" in signals.effort_units:
        return ""
    factors = np.abs(hypothesis.reading.effort_scale / signals.effort_scale)
    if np.all((factors > 1e-3 / FAR_GAIN) & (factors < 1e-3 * FAR_GAIN)):
        return "if efforts are in mNm, write gain = 0.001 under [signals.effort]; otherwise "
    if np.all((factors > LEAST_GEAR_RATIO) & (factors < LARGEST_GEAR_RATIO)):
        return (
            "if torques are those of motors, take the gear ratios from the data sheet: kind = "
            '"motor_torque", side = "motor" under [signals.effort], and ratios = [...] under '
            "[robot.transmission] (a new robot file: steelyard init MODEL LOG --side motor "
            "--ratios ...); otherwise "
        )
    far = np.flatnonzero((factors > FAR_GAIN) & (factors < LARGEST_GEAR_RATIO))
    if 0 < len(far) < len(factors):
        return (
            f"if the torque of {case.listed(far.tolist())} is that of the motor, write its gear "
            "ratio of the data sheet as its gain under [signals.effort]; otherwise "
        )
    return ""


def _of_controller(case: Case, gains: ControllerGains) -> Fix:
    """The controller's own gains; those that its targets do not show are left to be identified."""
    says = (
        "gains and masses cannot be identified together from this log; the controller's target "
        f"torque over its target current ({gains.columns[0]} over {gains.columns[1]}, friction "
        f"removed) gives the gains {gains.words(case.joints)} (95 %)"
    )
    unknown = [f"'{n}'" for n, known in zip(case.joints, gains.known, strict=True) if not known]
    if unknown:
        says += (
            f"; those of {', '.join(unknown)} are poorly identified from it: take them from the "
            'data sheet, or leave them at "identify", relative to the others'
        )
    return Fix(says, (Edit(("signals", "effort", "gain"), gains.entries),))


def _listed_sources(case: Case, *, sure: bool) -> str:
    source = case.loaded.sources[0].path.name if case.loaded.sources else "ROBOT"
    robot = source if source.endswith(".toml") else "ROBOT.toml"
    log = case.logs[0].log.path.name if len(case.logs) == 1 else "LOG..."
    entries = ['"identify"'] * len(case.joints)
    entries[min(1, len(entries) - 1)] = "1.0"
    one = f"[{', '.join(entries)}]"
    return (
        "gains and masses cannot be identified together from this log, and no number is written. "
        "In this order: (1) take gains from the controller's own target torque over its target "
        "current, or from the data sheet (torque constant times gear ratio); "
        '(2) write kind = "motor_current", unit = "A", gain = "identify" under [signals.effort] '
        f"and run `steelyard identify {robot} {log} --loaded LOADED_LOG --payload-mass KG` with a "
        f"log that carries a known mass; (3) without its mass, write gain = {one}, and run the "
        "same without --payload-mass: results are then up to one scale"
    ) + ("" if sure else GO_ON)


SOURCES_OF_GAINS = (
    "enter the gains of {} before identifying (data sheet: torque constant times gear ratio), or "
    "give `steelyard identify` a log that carries a known mass (--loaded LOG --payload-mass KG)"
)


DOUBTFUL_GAIN_FACTOR = 1.15
"""Factor from a controller's own gain from which on a declared one is doubtful."""


def gains_left(case: Case) -> tuple[Finding, ...]:
    """One doubtful finding for all logs where they do not show the gains that are left to them."""
    signals = case.loaded.signals
    if signals is None or not any(signals.unknown_gains):
        return ()
    pairs = list(zip(case.joints, signals.gains, signals.unknown_gains, strict=True))
    unknown = tuple(joint for joint, _, left in pairs if left)
    known = {joint: float(gain) for joint, gain, left in pairs if not left}
    try:
        model = with_any_speed(case.model)
        if case.runs:
            regressor = base_regressor(model)
            identified_gains(model, [gather(regressor, run) for run in case.runs], known=known)
    except DataError as error:
        says = f"the gains are not identifiable from these logs alone: {error.wrong}"
        figure = f"{len(unknown)} of {len(pairs)} gains to be identified"
        listed = ", ".join(f"'{joint}'" for joint in unknown) if known else "one joint or more"
        return (Finding.doubtful(says, figure, unknown, Fix(SOURCES_OF_GAINS.format(listed))),)
    except SteelyardError:
        pass
    return ()


def gains_of_controller(case: Case) -> tuple[Finding, ...]:
    """Declared gains beside target torque over target current; nothing without targets."""
    signals, found = case.loaded.signals, controller_gains(case)
    if signals is None or found is None:
        return ()
    declared, values = np.abs(signals.gains), found.values
    unknown = np.array(signals.unknown_gains or (False,) * signals.n)
    both = found.known & ~unknown
    if not both.any():
        return ()
    ratios = np.where(both, values, declared) / declared
    factor = np.exp(np.abs(np.log(ratios)))
    joints = np.flatnonzero(factor > DOUBTFUL_GAIN_FACTOR)
    source = f"{found.columns[0]} over {found.columns[1]}, friction fitted beside it"
    ratio, scale = float(np.median(ratios[both])), float(signals.effort_scale[0])
    for unit, size in CURRENT_UNITS.items():
        # in another unit the controller's gains would be about those declared
        if size != scale and abs(np.log(ratio * scale / size)) < np.log(OTHER_GAIN_FACTOR):
            says = f"by the controller's targets ({source}) efforts are in {unit}"
            figure = f"gains are {ratio:.4g} times the declared ones"
            line = (Edit(("signals", "effort", "unit"), unit),)
            return (Finding.wrong(says, figure, fix=Fix("declare the unit of the columns", line)),)
    figure = (
        f"gains differ from the controller's by {100.0 * (factor.max() - 1.0):.2g} % or less, "
        f"at most {100.0 * (DOUBTFUL_GAIN_FACTOR - 1.0):.0f} % allowed"
    )
    if not len(joints):
        what = "the gains" if np.all(signals.gains[both] > 0.0) else "the sizes of the gains"
        says = f"the controller's targets confirm {what} ({source})"
        if left := ", ".join(case.joints[j] for j in np.flatnonzero(~found.known)):
            says = f"undecided for {left}; {says} of the other joints"
        return (Finding.ok(says, figure, answered=not left),)
    listed = ", ".join(
        f"{case.joints[j]} {values[j]:.4g} ± {found.half_widths[j]:.2g}, declared {declared[j]:.4g}"
        for j in joints
    )
    says = f"the controller's targets give other gains: {listed}"
    entries: list[Gain] = np.where(unknown, "identify", signals.gains.astype(object)).tolist()
    for j in joints:
        entries[j] = float(f"{np.copysign(values[j], signals.gains[j]):.4g}")
    severity = Severity.WRONG if factor.max() > OTHER_GAIN_FACTOR else Severity.DOUBTFUL
    fix = Fix(
        f"take these gains, from {source}, or correct those of the data sheet",
        (Edit(("signals", "effort", "gain"), entries),),
    )
    return (Finding.of(severity, says, figure, tuple(case.joints[j] for j in joints), fix),)


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
        robot, reference = loaded.robot, 0
        nominal = Model(robot, (RigidBody(),)).prior if needs_gains(guess) and excerpts else None
        if nominal is not None:  # the joint whose nominal gravity effort varies most
            q = np.zeros((sum(len(x.t) for x in excerpts), robot.n))
            places = [robot.joint_names.index(c.name) for c in moving]
            q[:, places] = np.concatenate([_joints(x.z, signals) for x in excerpts], axis=1).T
            reference = int(np.argmax(nominal.gravity(q)[:, places].std(axis=0)))
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

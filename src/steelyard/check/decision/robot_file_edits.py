r"""Edits of the robot file that follow from a reading, tried before they are proposed.

Along the factor's logarithm $x$ the log-likelihood of a reading is a parabola near its top,
so that $\sigma_x^{-2} = -\mathrm d^2 \log L / \mathrm d x^2$, with the likelihood's honest number
of samples and what the model leaves for noise.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import SteelyardError
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.decision.ranked_readings import LogVerdict
from steelyard.check.finding import WRITTEN_DIGITS, Edit
from steelyard.check.hypotheses.gravity_payload_and_delay import refined_gravity
from steelyard.check.hypotheses.log_excerpt import excerpt_of
from steelyard.check.hypotheses.position_and_effort_hypotheses import PERCENT, ZERO_CAUSE
from steelyard.check.hypotheses.readings_and_likelihood import Likelihood, Reading, likelihood_of
from steelyard.check.hypotheses.sensors_contacts_and_limbs import (
    OF_BASE,
    SENSOR_DELAY,
    SENSOR_MOUNTING,
    roll_pitch_yaw,
)
from steelyard.check.signals.motion_units import unit_reading
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.sections import Gain
from steelyard.robot.file.signals import MOTOR_KINDS, Signals

ACCURACY_STEP = 0.03  # by how much the factor is changed either way, relative
LEAST_FACTOR_STD = 1e-3  # least standard deviation that is stated, relative


def spread_of(reading: Reading) -> float:
    """Largest relative std of fitted gains and ratios; 0 of declared ones, or infinity."""
    gains = reading.effort_scale / reading.likelihood.declared.effort_scale
    found, steps = [0.0], (-ACCURACY_STEP, 0.0, ACCURACY_STEP)
    for one in np.eye(len(gains)):
        factors = [np.exp(step * one) for step in steps]
        tried = []
        if reading.ratios @ one != 1.0:
            tried.append([reading.changed(ratios=reading.ratios * f) for f in factors])
        if abs(gains @ one) != 1.0:
            tried.append([reading.with_factors(f) for f in factors])
        for readings in tried:
            low, middle, high = (reading.log_likelihood for reading in readings)
            bend = (2.0 * middle - low - high) / ACCURACY_STEP**2
            std = bend**-0.5 if bend > 0.0 else np.inf
            found.append(max(LEAST_FACTOR_STD, float(std)))
    return max(found)


EFFORT_KEY = ("signals", "effort")


def edits_of(cause: str, reading: Reading, loaded: LoadedRobot) -> tuple[Edit, ...]:
    """The edits that one cause needs; all causes' edits together make the reading."""
    before, s = reading.likelihood.declared, reading.likelihood.signals
    joints, found = slice(s.n_base, None), list[Edit]()
    if cause == "joint order":
        position, effort = reading.position[joints], reading.effort[joints]
        if reading.position != before.position:
            found.append(Edit(("signals", "position"), [s.position[k] for k in position]))
        if reading.effort != before.effort:
            found.append(Edit((*EFFORT_KEY, "columns"), [s.effort[k] for k in effort]))
    elif cause == "position sign":
        signs = np.sign(reading.position_scale).astype(int).tolist()[joints]
        if signs != np.sign(before.position_scale).tolist()[joints]:
            found.append(Edit(("signals", "position_sign"), signs))
    elif cause == "effort delay":
        found.append(Edit((*EFFORT_KEY, "delay"), round(reading.delay, 4)))
    elif cause == "mounting":
        gravity = [round(float(x), 4) + 0.0 for x in refined_gravity(reading)]
        found += [Edit(("robot", "gravity"), gravity), Edit(("robot", "mounting"), None)]
    elif cause in OF_BASE:
        return base_edits(cause, reading)
    elif cause == ZERO_CAUSE:
        return zero_edits(reading)
    elif cause in ("effort sign", "effort unit", "effort kind", "gain"):
        return _effort(cause, reading, loaded)
    return tuple(found)


BASE_KEY = ("signals", "base")


def base_edits(cause: str, reading: Reading) -> tuple[Edit, ...]:
    """How the sensor of a floating base is mounted, its delay, and contacts as they are."""
    base, floats = reading.base, reading.likelihood.base
    if base is None or floats is None:
        return ()
    signals = floats.signals
    if cause == SENSOR_DELAY:
        return (Edit((*BASE_KEY, "delay"), round(base.delay, 4)),)
    if cause == SENSOR_MOUNTING:
        angles = roll_pitch_yaw(base.turn @ np.reshape(signals.axes, (3, 3)))
        values = {x: float(np.round(y, 2)) + 0.0 for x, y in zip(ANGLES, angles, strict=True)}
        place: dict[str, Any] = {"position": [round(x, 6) for x in signals.place]}
        given = {**values, **(place if any(signals.place) else {})}
        key = (*BASE_KEY, "mounting")
        return (
            *(Edit((*key, name), value) for name, value in given.items()),
            Edit((*BASE_KEY, "frame"), None),
        )
    tables = []
    for contact, number, world in zip(signals.contacts, base.contacts, base.in_world, strict=True):
        columns = list(signals.contacts[number].columns)
        parts = {"force": columns[:3], "moment": columns[3:]}
        axes = {"axes": "world"} if world else {}
        tables.append({"frame": contact.frame, **{k: v for k, v in parts.items() if v}, **axes})
    return (Edit((*BASE_KEY, "contacts"), tables),)


ANGLES = ("roll", "pitch", "yaw")


def zero_edits(reading: Reading) -> tuple[Edit, ...]:
    """Zero offsets of all joints."""
    given = reading.likelihood.signals.position_offset
    zeros = np.zeros(len(reading.position)) if given is None else given
    if reading.zeros is not None:
        zeros = zeros + reading.zeros
    return (Edit(("signals", "position_offset"), [round(float(x), 4) + 0.0 for x in zeros]),)


def _effort(cause: str, after: Reading, loaded: LoadedRobot) -> tuple[Edit, ...]:
    before, s = after.likelihood.declared, after.likelihood.signals
    if np.any(after.ratios != 1.0):
        return _ratios(after, loaded)

    def of(key: str, value: Any, spread: float = 0.0) -> Edit:
        return Edit((*EFFORT_KEY, key), value, spread)

    factors = after.effort_scale / before.effort_scale
    kinds = () if after.kind in (before.kind, PERCENT) else (of("kind", after.kind),)
    if after.kind == "gravity_compensated_torque" != before.kind:
        if before.kind in MOTOR_KINDS or "A" in s.effort_units:
            return (Edit(("robot", "gravity"), [0.0, 0.0, 0.0]),)
        return kinds
    gains = file_gains(after.likelihood, loaded) * factors
    # of a gain that was fitted; signs and units are exact
    gain = of("gain", _entries(s, gains), spread_of(after) if cause == "gain" else 0.0)
    if after.kind == PERCENT:
        return of("kind", "motor_torque"), of("unit", "%"), gain
    if after.kind == "motor_current" != before.kind:
        return (*kinds, of("unit", "A"), gain)
    if after.kind == "joint_torque" and before.kind == "motor_current":
        units = list(loaded.robot.effort_units)[s.n_base :]
        one = units[0] if len(set(units)) == 1 else units
        return (*kinds, of("unit", one), of("gain", None))
    if set(s.effort_units[s.n_base :]) == {"A"} and np.allclose(
        np.abs(factors), np.abs(factors[0])
    ):
        unit = {1.0: "A", 1e-3: "mA"}.get(round(float(np.abs(after.effort_scale[0])), 9))
        if unit is not None and abs(factors[0]) != 1.0:
            signed = of("gain", _entries(s, gains / np.abs(factors)))
            return (of("unit", unit), *[signed] * bool(np.any(factors <= 0.0)))
    return (gain,)


def _entries(signals: Signals, gains: Array) -> list[Gain]:
    """The gains as the robot file states them; those that are to be identified stay so."""
    gains = gains[signals.n_base :]
    unknown = signals.unknown_gains[signals.n_base :] or (False,) * len(gains)
    rounded = (float(f"{x:.{WRITTEN_DIGITS}g}") for x in gains)
    return ["identify" if left else x for x, left in zip(rounded, unknown, strict=True)]


def _ratios(after: Reading, loaded: LoadedRobot) -> tuple[Edit, ...]:
    """Gear ratios: the whole number where the interval of the fitted one holds it."""
    gears = loaded.robot.transmission
    if gears is None:
        return ()
    found, spread = [], spread_of(after)
    for ratio, factor in zip(np.diag(gears.matrix), after.ratios, strict=True):
        value = float(f"{ratio * factor:.{WRITTEN_DIGITS}g}") if factor != 1.0 else float(ratio)
        whole, width = float(round(value)), Z95 * spread * abs(value) * (factor != 1.0)
        found.append(whole if abs(value - whole) <= width else value)
    return (Edit(("robot", "transmission", "ratios"), found, spread),)


def file_gains(likelihood: Likelihood, loaded: LoadedRobot) -> Array:
    """Gains as the robot file gives them: behind what its gears do, shape `(n,)`."""
    s, gears = likelihood.signals, loaded.robot.transmission
    if gears is None:
        return likelihood.gains
    if s.effort_map is not None:
        return np.asarray(np.diag(np.linalg.solve(gears.matrix.T, s.effort_map)))
    if s.effort_side == "motor":
        return np.asarray(likelihood.gains / np.diag(gears.matrix))
    return likelihood.gains


def velocity_edits(case: Case, log: CheckedLog, reading: Reading) -> tuple[Edit, ...]:
    """What declared velocities need beside positions of a reading; nothing without any."""
    before, s = reading.likelihood.declared, log.recording.signals
    columns = list(reading.position)
    turned = np.sign(reading.position_scale) * np.sign(before.position_scale)[columns]
    if s.velocity is None or s.velocity_scale is None:
        return ()
    if reading.position == before.position and (turned > 0.0).all():
        return ()
    order, signs, agreed = np.arange(s.n), np.ones(s.n), unit_reading(case, log).agreement
    if agreed is not None:  # velocities that are those of other positions as declared
        known = agreed.reliable_joints
        order, signs = agreed.order, np.where(known, np.sign(agreed.scale), 1.0)
    order, own, found = order[columns], np.sign(s.velocity_scale), list[Edit]()
    if not np.array_equal(order, np.arange(s.n)):
        found.append(Edit(("signals", "velocity"), [s.velocity[c] for c in order]))
    signs = signs[columns] * turned * own[order]
    if not np.array_equal(signs, own):
        found.append(Edit(("signals", "velocity_sign"), [int(x) for x in signs]))
    return tuple(found)


CLOSE_MISFIT_FACTOR = 1.05  # misfit over the winner's up to which edits do what they should
ROUNDING_SLACK = 0.5  # and what rounding may add [%]


def confirmed(case: Case, log: CheckedLog, edits: Sequence[Edit], decision: LogVerdict) -> bool:
    """Whether the edited robot file, if there is one, reads the log as the last winner does."""
    from steelyard.robot.file.robot_file import load_robot, robot_text
    from steelyard.robot.file.toml_edits import edited

    source = case.loaded.sources[0] if case.loaded.sources else None
    if not edits or source is None or source.path.suffix.lower() != ".toml":
        return True
    if not source.path.is_file():
        return True
    try:
        text = robot_text(source.path)
        if hashlib.sha256(text.encode()).hexdigest() != source.sha256:
            return True
        corrected = load_robot(source.path, edited(text, edits))
    except SteelyardError:
        return False
    signals, likelihood, last = corrected.signals, decision.likelihood, decision.written[-1]
    if signals is None:
        return False
    recording = replace(log.recording, signals=signals)
    excerpt = excerpt_of(recording, log.processing, likelihood.excerpt.cutoff)
    if excerpt is None:
        return False
    unknown = np.array(signals.unknown_gains or [False] * signals.n)
    gains = np.where(unknown, likelihood.gains, signals.gains)
    again = likelihood_of(
        excerpt, signals, likelihood.knowledge, corrected.robot, gains, likelihood.scales
    )
    reading = again.declared.changed(payload=last.reading.payload)
    return reading.percent <= CLOSE_MISFIT_FACTOR * last.reading.percent + ROUNDING_SLACK

r"""Do the sensors of a floating base agree with each other, and are they alive?

Between two rows $h$ apart an orientation $R$ turns by $\log(R_k^T R_{k+h})$ along its own axes,
which the integral of the angular velocity has to be. Over a log whose robot stays in a room, the
proper acceleration has the mean $-g$ in the world; without an orientation its direction $u$ turns
by $\dot u = -\omega \times u$, and its size is about that of $g$.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from steelyard.base.arrays import Array, stretches
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check, remembered
from steelyard.check.decision.robot_file_edits import BASE_KEY
from steelyard.check.finding import Edit, Finding, Fix, Severity
from steelyard.check.signals.motion_units import unit_reading
from steelyard.robot.file.base_signals_from_tables import STANDARD_G
from steelyard.robot.file.signals import BaseSignals
from steelyard.runs.floating_base import rotations

TURN_TIME = 0.1  # time between two orientations that are compared [s]
SLOW_TIME = 0.3  # time over which accelerations are averaged where no orientation is logged [s]
LEAST_TURN = 0.02  # root mean square of turns that are compared [rad]
AGREEING, DISAGREEING = 0.35, 0.6
"""Relative difference of turns up to which sensors agree, and from which on they do not."""
LEAST_RATE_BIAS = 0.05
"""Bias of a gyroscope that matters [rad/s]: with 0.17, 88 % of 95 % intervals hold the truth."""
UPRIGHT = 0.3  # distance of the mean acceleration from that of a robot that stays, over gravity
MOVING = 0.2  # spread of a signal in a stretch, over that in the log, from which on it changes
DEAD_TIME, DEAD_ROWS = 0.5, 50  # shortest stretch of one value that is no measurement [s; rows]
CONJUGATE = "turned from the world to the sensor, not from the sensor to the world"
KINDS = {4: ("wxyz", "xyzw"), 3: ("rpy_rad", "rpy_deg"), 9: ("matrix",)}
RATE_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180.0}
LOG_GRAVITY = Fix("log what an accelerometer measures, +9.81 m/s² upwards at rest")


@dataclass(frozen=True, eq=False)
class SensorRows:
    """Good rows of the sensors of a base: `(N,)` [s], `(N, k)`; empty if not logged.

    As logged, without biases that are stated.
    """

    t: Array
    acceleration: Array  # or positions
    rate: Array
    orientation: Array
    pushes: Array


@remembered
def sensor_rows(log: CheckedLog) -> SensorRows:
    """Rows of a log whose base floats."""
    signals, base = log.recording.signals, log.recording.signals.base
    assert base is not None
    columns = (signals.time, *base.motion, *base.pushes)
    parts = list(log.log.parts(columns, log.window))
    rows = np.concatenate(parts) if parts else np.zeros((0, len(columns)))
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows = rows[
        np.concatenate(([True], np.diff(np.maximum.accumulate(rows[:, 0])) > 0.0))[: len(rows)]
    ]
    ends = np.cumsum([3, len(base.angular_velocity), len(base.orientation)])
    acceleration, rate, *rest = np.split(rows[:, 1:], ends, axis=1)
    acceleration = acceleration - np.array(base.bias) / base.scale
    if base.angular_velocity:
        rate = rate - np.array(base.angular_bias) / base.angular_scale
    return SensorRows(rows[:, 0] * signals.time_scale, acceleration, rate, *rest)


_Otherwise = tuple[str, tuple[Edit, ...]]
"""Another way to read the sensors in words, and the lines that say so."""


@case_check("sensors of the base", "Do the sensors of the base agree with each other?")
def base_sensors_check(case: Case) -> Iterable[Finding]:
    """Sensors that stop, kinds of orientations, units, axes and signs of rates, gravity."""
    for log in case.logs:
        base = log.recording.signals.base
        if base is None or len(sensor_rows(log).t) < DEAD_ROWS:
            continue
        rows, second = sensor_rows(log), unit_reading(case, log).second
        rows = replace(rows, t=rows.t * second)
        found = [*_dead(base, rows)]
        if not found:
            found = list(_of_turns(base, rows)) if base.orientation else []
            if not any(f.severity == Severity.WRONG for f in found):
                found += _of_gravity(base, rows)
            if base.angular_velocity and not base.orientation:
                found += _of_direction(base, rows)
        bad = [f for f in found if f.severity] or found
        for one in bad or [Finding.ok("nothing to compare", answered=False)]:
            yield replace(one, log=log.name)


def _dead(base: BaseSignals, rows: SensorRows) -> Iterator[Finding]:
    """Columns that keep one value, of a contact one that is not zero, or all of them for good."""
    step = float(np.median(np.diff(rows.t)))
    least = max(DEAD_ROWS, round(DEAD_TIME / max(step, 1e-9)))
    sensors = np.column_stack((rows.acceleration, rows.rate, rows.orientation))
    every = np.column_stack((sensors, rows.pushes))

    def moves(start: int, stop: int) -> bool:
        """Whether anything else changes meanwhile as it does elsewhere."""
        spread = every.std(axis=0)
        own = every[start : stop + 1].std(axis=0)
        return bool(np.any((own > MOVING * spread) & (spread > 0.0)))

    signals = [(name, x[:, None], False) for name, x in zip(base.motion, sensors.T, strict=True)]
    ends = np.cumsum([len(contact.columns) for contact in base.contacts])[:-1]
    forces = np.split(rows.pushes, ends, axis=1) if base.contacts else []
    for contact, x in zip(base.contacts, forces, strict=True):
        signals.append((f"force at '{contact.frame}'", x, True))
    still = []
    for name, x, force in signals:
        if force and not x.any():
            yield Finding.doubtful(
                f"the {name} keeps one value, zero: it is not measured, or nothing touches it",
                fix=Fix(f"log the {name} if anything touches it; if not, leave the contact out"),
            )
        if np.ptp(x) == 0.0 and np.ptp(sensors) > 0.0 and x[0, 0] in (0.0, 1.0):
            continue  # of a motion that a plane contains
        same = (np.diff(x, axis=0) == 0.0).all(axis=1) & (not force or (x[1:] != 0.0).any(axis=1))
        long = [(a, b) for a, b in stretches(same) if b - a >= least and moves(a, b)]
        if long:
            first, last = max(long, key=lambda one: one[1] - one[0])
            still.append((name, rows.t[first] - rows.t[0], rows.t[last] - rows.t[0]))
    if still:
        names = ", ".join(dict.fromkeys(name for name, _, _ in still))
        _, a, b = still[0]
        yield Finding.wrong(
            f"{names}: one value from {a:.3g} to {b:.3g} s: the sensor stopped",
            f"{b - a:.3g} s, at most {DEAD_TIME:g} s allowed",
            fix=Fix("leave that part out (LOG@START:STOP), or record again"),
        )


def turns_of(axes: Array, apart: int) -> Array:
    """Turns `(M, 3)` [rad] of axes `(N, 3, 3)` between rows that are so many apart."""
    from scipy.spatial.transform import Rotation

    between = axes[:-apart].transpose(0, 2, 1) @ axes[apart:]
    return np.asarray(Rotation.from_matrix(between).as_rotvec())


def _readings(base: BaseSignals) -> Iterator[tuple[str, bool]]:
    """Kinds of orientations with as many columns, and whether they are turned the other way."""
    kinds = [base.orientation_kind, *KINDS[len(base.orientation)]]
    yield from product(dict.fromkeys(kinds), (False, True))


def _axes(rows: SensorRows, kind: str, other: bool) -> Array:
    axes = rotations(rows.orientation, kind)
    return axes.transpose(0, 2, 1) if other else axes


def _words(base: BaseSignals, kind: str, other: bool) -> _Otherwise:
    edits = (Edit((*BASE_KEY, "orientation_kind"), kind),) if kind != base.orientation_kind else ()
    says = f'the orientation is "{kind}"' if edits else "the orientation is"
    return f"{says}{', ' + CONJUGATE if other else ''}", () if other else edits


def _rate_unit(unit: str) -> _Otherwise:
    return f"the angular velocity is in {unit}", (Edit((*BASE_KEY, "angular_velocity_unit"), unit),)


def _wrong(found: _Otherwise, declared: str, figure: str) -> Finding:
    """That sensors are read otherwise, and what speaks against what is declared."""
    says, edits = found
    return Finding.wrong(f"{says}: as declared, {declared}", figure, fix=Fix(says, edits))


def _of_turns(base: BaseSignals, rows: SensorRows) -> Iterator[Finding]:
    """Whether orientation and gyroscope turn alike."""
    apart = max(1, round(TURN_TIME / float(np.median(np.diff(rows.t)))))
    if not base.angular_velocity or len(rows.t) < 4 * apart:
        return
    step = np.diff(rows.t)[:, None]
    angle = np.vstack((np.zeros(3), np.cumsum(0.5 * step * (rows.rate[1:] + rows.rate[:-1]), 0)))
    logged = angle[apart:] - angle[:-apart]

    def off(turned: Array, rate: Array) -> float:
        size = np.sqrt(np.mean(np.square(turned)) * np.mean(np.square(rate)))
        return float(np.sqrt(np.mean(np.square(turned - rate))) / max(float(size), 1e-12))

    tried: list[tuple[float, float, _Otherwise]] = []
    declared = np.inf
    for number, (kind, other) in enumerate(_readings(base)):
        turned = turns_of(_axes(rows, kind, other), apart)
        if number == 0:
            declared = off(turned, base.angular_scale * logged)
            if np.sqrt(np.mean(np.square(turned))) < LEAST_TURN:
                return
        for unit, scale in RATE_UNITS.items():
            for says, matrix in _axes_of_rates():
                changes = [] if number == 0 else [_words(base, kind, other)]
                if scale != base.angular_scale:
                    changes.append(_rate_unit(unit))
                if says:
                    changes.append((says, _edits_of_axes(base, matrix)))
                both = (
                    " and ".join(says for says, _ in changes),
                    tuple(edit for _, edits in changes for edit in edits),
                )
                tried.append((off(turned, scale * logged @ matrix.T), float(len(changes)), both))
    figure = (
        f"turns in {TURN_TIME:g} s differ by {100.0 * declared:.2g} %, at most "
        f"{100.0 * AGREEING:.0f} % allowed"
    )
    if declared <= AGREEING:
        yield from _of_rate_bias(base, rows, logged, apart, off) or [
            Finding.ok("orientation and angular velocity agree", figure)
        ]
        return
    least = min(one[0] for one in tried)
    best = min((one for one in tried if one[0] < 1.3 * least), key=lambda one: one[1])
    if best[0] <= AGREEING and declared > 1.5 * best[0]:
        figure = f"{figure}; so {100.0 * best[0]:.2g} %"
        yield _wrong(best[2], "orientation and angular velocity disagree", figure)
    elif found := _of_rate_bias(base, rows, logged, apart, off):
        yield from found
    elif declared > DISAGREEING:
        yield Finding.doubtful(
            "orientation and angular velocity are not of one sensor, or have other axes or clocks",
            figure,
            fix=Fix("check columns, axes and clock of the gyroscope and of the orientation"),
        )


def _of_rate_bias(
    base: BaseSignals, rows: SensorRows, logged: Array, apart: int, off: Callable[..., float]
) -> list[Finding]:
    """A bias of the gyroscope, if orientation and angular velocity agree without it."""
    turned = turns_of(_axes(rows, base.orientation_kind, False), apart)
    times = (rows.t[apart:] - rows.t[:-apart])[:, None]
    rate = base.angular_scale * logged
    bias = np.median((rate - turned) / times, axis=0)
    size = float(np.linalg.norm(bias))
    if size <= LEAST_RATE_BIAS or off(turned, rate - bias * times) > AGREEING:
        return []
    whole = ", ".join(f"{x:.4f}" for x in np.array(base.angular_bias) + bias)
    figure = f"mean difference {size:.2g} rad/s, at most {LEAST_RATE_BIAS:g} rad/s allowed"
    fix = Fix(f"state it in [signals.base]: angular_velocity_bias = [{whole}]")
    says = f"the gyroscope has a bias of {size:.2g} rad/s against the orientation"
    return [Finding.doubtful(says, figure, fix=fix)]


def _axes_of_rates() -> Iterator[tuple[str, Array]]:
    """Signs and orders of the axes of a gyroscope, in words."""
    yield "", np.eye(3)
    for signs in product((1.0, -1.0), repeat=3):
        if signs != (1.0, 1.0, 1.0):
            which = ", ".join(x for x, sign in zip("xyz", signs, strict=True) if sign < 0.0)
            yield f"the angular velocity along {which} has the opposite sign", np.diag(signs)
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            listed = ", ".join("xyz"[k] for k in order)
            yield (
                f"the angular velocity's columns are in the order {listed}",
                np.eye(3)[list(order)],
            )


def _edits_of_axes(base: BaseSignals, matrix: Array) -> tuple[Edit, ...]:
    """Columns in another order; no key states signs."""
    if (matrix < 0.0).any():
        return ()
    columns = [base.angular_velocity[int(np.argmax(row))] for row in matrix]
    return (Edit((*BASE_KEY, "angular_velocity"), columns),)


def _of_gravity(base: BaseSignals, rows: SensorRows) -> Iterator[Finding]:
    """Whether the mean acceleration is that of a robot that stays, in the world or by its size."""
    if base.tracked:
        return
    g = -np.array(base.gravity)
    size = float(np.linalg.norm(g))
    if size == 0.0:
        return
    if not base.orientation:
        yield from _of_size(base, rows, size)
        return
    scaled = base.scale * rows.acceleration

    def mean(kind: str, other: bool) -> Array:
        return np.asarray(np.einsum("nij,nj->ni", _axes(rows, kind, other), scaled).mean(axis=0))

    declared = mean(base.orientation_kind, False)
    off = float(np.linalg.norm(declared - g)) / size
    figure = (
        f"mean acceleration in the world {np.round(declared, 2).tolist()} m/s², "
        f"{np.round(g, 2).tolist()} m/s² expected of a robot that stays"
    )
    if off <= UPRIGHT:
        yield Finding.ok("the acceleration has gravity in it, upwards", figure)
        return
    if abs(np.linalg.norm(declared + g)) / size <= UPRIGHT:
        yield Finding.wrong(
            "the acceleration has the opposite sign: at rest it points down, and an accelerometer "
            "measures upwards",
            figure,
            fix=LOG_GRAVITY,
        )
        return
    found = list(_of_size(base, rows, size))
    if any(f.severity for f in found):
        yield from found
        return
    for kind, other in _readings(base):
        if np.linalg.norm(mean(kind, other) - g) / size <= UPRIGHT:
            declared_words = "gravity is not along the world's z axis"
            yield _wrong(_words(base, kind, other), declared_words, figure)
            return
    yield Finding.doubtful(
        "acceleration and orientation disagree about where gravity points",
        figure,
        fix=Fix(
            "check kind and columns of the orientation, and signs and axes of the acceleration"
        ),
    )


def _of_size(base: BaseSignals, rows: SensorRows, size: float) -> Iterator[Finding]:
    """Units of the acceleration, and whether gravity is in it, by its size over short times."""
    smooth = _means(rows, base.scale * rows.acceleration)
    mean = float(np.median(np.linalg.norm(smooth, axis=1)))
    figure = f"size of the acceleration {mean:.3g} m/s², {size:.3g} m/s² expected"
    for factor, unit in ((STANDARD_G, "g"), (1.0 / STANDARD_G, "m/s2")):
        near = abs(mean * factor / size - 1.0) < UPRIGHT
        spread = float(np.std(np.linalg.norm(smooth, axis=1))) / max(mean, 1e-12)
        declared = "g" if base.scale != 1.0 else "m/s2"
        if near and unit != declared and spread < UPRIGHT:
            line = Edit((*BASE_KEY, "acceleration_unit"), unit)
            found = f'the acceleration is in "{unit}"', (line,)
            yield _wrong(found, f"it is {mean / size:.2g} times gravity", figure)
            return
    if mean < UPRIGHT * size and (base.contacts or base.orientation):
        yield Finding.wrong(
            "the acceleration is without gravity, and an accelerometer measures it",
            figure,
            fix=LOG_GRAVITY,
        )
        return
    yield Finding.ok("the acceleration has the size of gravity", figure)


def _means(rows: SensorRows, x: Array) -> Array:
    """Means of signals `(N, 3)` over short times."""
    width = max(1, round(SLOW_TIME / float(np.median(np.diff(rows.t)))))
    count = len(x) // width
    return np.asarray(x[: count * width].reshape(count, width, -1).mean(axis=1))


def _of_direction(base: BaseSignals, rows: SensorRows) -> Iterator[Finding]:
    """Whether the direction of the acceleration turns as the gyroscope says."""
    if base.tracked:
        return
    up = _means(rows, rows.acceleration)
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-12)
    rate = base.angular_scale * _means(rows, rows.rate)
    turned = 0.5 * (rate[1:] + rate[:-1]) * SLOW_TIME
    moved, expected = np.diff(up, axis=0), -np.cross(turned, 0.5 * (up[1:] + up[:-1]))
    if np.sqrt(np.mean(np.square(moved))) < LEAST_TURN:
        return
    slope = float(np.sum(moved * expected) / max(float(np.sum(np.square(expected))), 1e-12))
    correlation = float(
        np.sum(moved * expected)
        / max(float(np.linalg.norm(moved) * np.linalg.norm(expected)), 1e-12)
    )
    figure = f"the acceleration turns {slope:.3g} times as far as the gyroscope says"
    for unit, scale in RATE_UNITS.items():
        there = slope * base.angular_scale / scale
        if (
            scale != base.angular_scale
            and AGREEING < there < 1.0 / AGREEING
            and correlation > AGREEING
        ):
            yield _wrong(_rate_unit(unit), "it does not fit gravity", figure)
            return
    if slope < 0.0 and correlation < -DISAGREEING:
        yield Finding.wrong(
            "acceleration and angular velocity have opposite signs",
            figure,
            fix=Fix("check signs and axes of both"),
        )
        return
    yield Finding.ok("acceleration and angular velocity turn alike", figure)

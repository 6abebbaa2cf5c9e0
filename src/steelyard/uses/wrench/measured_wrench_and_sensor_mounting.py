r"""The wrench that a force/torque sensor measured along a log, in the frame of the estimated one.

Where nothing touches the sensor it reads its bias $b$ and, with gravity $g$ in its axes, the weight
of what it carries, $y = b + (m g, h \times g)$ with mass $m$ and first moment $h$ about its origin.
In motion $g$ is $g - \ddot p$, and the force has $\dot\omega \times h$ and the centrifugal part
too; moments of inertia are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import DataError, advice
from steelyard.estimate.external.wrench_methods_and_observer_step import moved_frame
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import significant
from steelyard.robot.inertia_and_placement import Placement, rpy_of, rpy_rotation, skew
from steelyard.robot.robot import Frame
from steelyard.runs.run import Block, Run
from steelyard.runs.runs_of_named_logs import LogArgument, recording_of
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import zero_phase
from steelyard.uses.wrench.wrench_along_run import COMPONENTS, WrenchEstimate
from steelyard.uses.wrench.wrench_kalman_smoother import OBSERVABLE

WRENCH_TABLE_COLUMNS = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
"""Force and moment in tables; `steelyard simulate --wrench` reads the same names."""

UNITS = ("N", "N", "N", "Nm", "Nm", "Nm")

NUMBERED = (
    WRENCH_TABLE_COLUMNS,
    tuple("123456"),
    tuple("012345"),
    ("fx", "fy", "fz", "tx", "ty", "tz"),
    ("fx", "fy", "fz", "mx", "my", "mz"),
    ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"),
    ("Fx", "Fy", "Fz", "Mx", "My", "Mz"),
)
"""What `{}` stands for in a pattern of columns: the first of these whose six columns a log has."""

SensorSign = Literal["on_robot", "by_robot"]

LEAST_REST = 0.2  # least time at rest of which a bias is taken [s]
LEAST_TURN = 0.1  # least spread of gravity's direction [rad] of which a weight is estimated
MUCH_BETTER = 0.25  # share of the squared difference that another sign or turn may leave
LEAST_APART = 0.05  # squared difference over squared forces from which others are tried
MOST_DISTANCE = 3.0  # of a place of the sensor that is named from its stated place [m]
AS_GOOD = 1.5  # ratio of squared differences up to which the simpler of two is named


@dataclass(frozen=True, eq=False)
class Sensor:
    """A force/torque sensor of a log."""

    columns: tuple[str, ...]  # force [N], then moment [Nm], about its origin, along its axes
    base: Frame  # link or frame that it is placed in
    placement: Placement  # there
    sign: SensorSign  # whether it reads the wrench on the robot or that by the robot
    rest: tuple[tuple[float, float], ...]  # where nothing touches it [s]; empty: rest at the start

    @property
    def frame(self) -> Frame:
        """Where it is on its body."""
        placed = Placement(self.base.rotation, self.base.position) @ self.placement
        return Frame("sensor", self.base.body, placed.rotation, placed.position)

    @property
    def words(self) -> str:
        """Frame and sign for people to read."""
        at = " ".join(f"{x:.4g}" for x in self.numbers)
        placed = f" at {at} (m, rad)" if any(self.numbers) else ""
        return f"on {self.base.name}{placed}, wrench {self.sign.replace('_', ' the ')}"

    @property
    def numbers(self) -> tuple[float, ...]:
        """Position [m] and roll, pitch and yaw [rad] in `base`."""
        found = (*self.placement.position, *rpy_of(self.placement.rotation))
        return tuple(float(x) + 0.0 for x in found)


def sensor_columns(known: Sequence[str], given: Sequence[str], where: str) -> tuple[str, ...]:
    """Six columns of a log: as named, of a pattern with `{}`, or those that `auto` finds."""
    if len(given) == 1:
        pattern = "{}" if given[0] == "auto" else given[0]
        made = [tuple(pattern.replace("{}", one) for one in six) for six in NUMBERED]
        found = next((six for six in made if "{}" in pattern and set(six) <= set(known)), None)
        given = found or (made[0] if "{}" in pattern else given)
    missing = next((name for name in given if name not in known), None)
    if missing is not None:
        raise DataError(
            f"the log has no column '{missing}' of a force/torque sensor (--measured)",
            where=where,
            fix=f"{advice(missing, known, 'columns')}; name six: force x, y, z [N], moment x, y, "
            "z [Nm], or a pattern such as ft_{}",
        )
    if len(set(given)) != 6:
        raise DataError(
            f"{len(set(given))} columns are named for a force/torque sensor (--measured), not six",
            where=where,
            fix="name six: force x, y, z [N], moment x, y, z [Nm], or a pattern such as ft_{}",
        )
    return tuple(given)


def sensor_placement(given: str | Sequence[float]) -> Placement:
    """The placement that `external_wrench` is given, such as "0 0 0.05 0 0 1.57" (m, rad)."""
    try:
        numbers = [float(x) for x in (given.split() if isinstance(given, str) else given)]
    except ValueError:
        numbers = [np.nan]
    if len(numbers) not in (0, 3, 6) or not np.isfinite(numbers).all():
        raise DataError(
            f"'{given}' is no place of a sensor (--sensor-at)",
            where="wrench",
            fix="give x, y, z [m] and, if it is turned, roll, pitch, yaw [rad], such as "
            '"0 0 0.05 0 0 1.57"',
        )
    x = np.concatenate([numbers, np.zeros(6 - len(numbers))])
    return Placement(rpy_rotation(*x[3:]), x[:3])


def stretch_of_rest(text: str) -> tuple[float, float]:
    """Start and stop [s] of a text such as `0:1.5`."""
    start, colon, stop = text.partition(":")
    try:
        found = float(start or "0"), float(stop or "inf")
    except ValueError:
        found = 0.0, -1.0
    if not colon or not 0.0 <= found[0] < found[1]:
        wrong = f"'{text}' is no stretch of time (--sensor-rest)"
        fix = "give START:STOP in seconds from the log's start, such as 0:1.5"
        raise DataError(wrong, where="wrench", fix=fix)
    return found


@dataclass(frozen=True, eq=False)
class SensorLoad:
    """What a sensor reads where nothing touches it, along its axes, as a wrench on the robot."""

    bias: Array  # shape `(6,)` [N, Nm]
    duration: float  # time at rest that it is of [s]
    mass: float | None = None  # of what it carries [kg]; `None`: part of the bias
    first_moment: Array | None = None  # about its origin, shape `(3,)` [kg m]


@dataclass(frozen=True)
class ComponentError:
    """Estimate minus measurement of one component over a log, values in its unit."""

    component: str
    unit: str
    mean: float
    std: float
    # sum of absolute differences over that of the measured values' deviations from their mean
    relative_absolute: float | None
    relative: float | None  # sum of absolute differences over that of the measured values
    within_interval: float  # share of the samples at which the 95 % interval holds the measured one

    @property
    def row(self) -> Row:
        """For people to read."""
        name = f"{self.component.replace(' along', '').replace(' about', '')} [{self.unit}]"
        errors = (self.mean, self.std, self.relative_absolute, self.relative)
        inside = f"{100.0 * self.within_interval:.0f} %"
        return Row((name, *(significant(x) for x in errors), inside))


@dataclass(frozen=True, eq=False)
class MeasuredWrench:
    """The measured wrench on the robot at the times of an estimate, about its frame's origin."""

    sensor: Sensor
    wrench: Array  # less bias and weight, behind the estimate's low-pass, shape `(N, 6)` [N, Nm]
    carried: SensorLoad
    errors: tuple[ComponentError, ...]
    better: str  # option with which the forces would fit much better, and how much; empty if none

    @property
    def words(self) -> str:
        """Where it was measured, and what was taken off."""
        own, force = self.carried, significant(float(np.linalg.norm(self.carried.bias[:3])))
        rest = f"its bias, {force} N, is the mean of {own.duration:.3g} s at rest"
        text = f"Sensor {self.sensor.words}; {rest}"
        if own.mass is None:
            return f"{text}, with the weight of what it carries in that posture"
        return f"{text}; it carries {significant(own.mass)} kg, which is taken off"

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against the sensor as it was described."""
        found = [self.better] if self.better else []
        if self.carried.mass is not None and self.carried.mass < 0.0:
            found.append(
                f"the sensor carries {self.carried.mass:.3g} kg by its columns: its sign "
                "(--sensor-sign), or its frame, is another one"
            )
        return tuple(found)

    def table(self) -> PlainTable:
        """One row per component."""
        words = (
            f"{self.words}. Estimate minus measured. Of spread: sum of absolute differences over "
            "that of the measured values' deviations from their mean; of size: over that of the "
            "measured values."
        )
        headings = ("", "mean", "std", "of spread", "of size", "inside 95 %")
        return PlainTable("Measured wrench", words, headings, [one.row for one in self.errors])

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        own, sensor = self.carried, self.sensor
        moment = None if own.first_moment is None else own.first_moment.tolist()
        return {
            "columns": list(sensor.columns),
            "sensor": {"frame": sensor.base.name, "at": sensor.numbers, "sign": sensor.sign},
            "bias": dict(zip(WRENCH_TABLE_COLUMNS, own.bias.tolist(), strict=True)),
            "rest_s": own.duration,
            "carried": {"mass_kg": own.mass, "first_moment_kg_m": moment},
            "components": [vars(one) for one in self.errors],
        }


def measured_wrench(
    identified: IdentifiedModel,
    run: Run,
    file: LogArgument,
    sensor: Sensor,
    estimate: WrenchEstimate,
) -> MeasuredWrench:
    """The wrench of a sensor beside an estimate along the same run.

    Raises:
        DataError: The sensor is on another body than the estimate's frame, its columns hold no
            numbers, or nothing is at rest where its bias is taken.
    """
    place = moved_frame(identified.robot, estimate.frame)
    if sensor.base.body != place.body:
        raise DataError(
            f"the sensor is on '{sensor.base.name}', but joints lie between it and the frame "
            f"'{place.name}' of the wrench",
            where=run.name,
            fix="estimate on a frame of the sensor's own link (--frame), or name the sensor's link "
            "(--sensor)",
        )
    whole = replace(run, span=(-np.inf, np.inf))
    t, logged = _logged(run, file, sensor)
    logged = logged if sensor.sign == "on_robot" else -logged
    segments = by_key((block.segment, block) for block in whole.blocks())
    blocks = [Block.joined(some) for some in segments.values()]
    read = [np.column_stack([np.interp(one.t, t, x) for x in logged.T]) for one in blocks]
    axes = [identified.pose(one.q.T, sensor.frame)[1] for one in blocks]
    carried = _carried(identified, run, file.cut.seconds[0], blocks, read, axes, sensor)
    own = Placement(place.rotation, place.position)
    there = Placement(sensor.frame.rotation, sensor.frame.position)
    parts = []
    for block, values, turned in zip(blocks, read, axes, strict=True):
        touching = values - carried.bias
        if carried.mass is not None:
            touching -= _load(identified, block, turned, sensor.frame, carried)
        moved = _moved(touching, own, there)
        if estimate.axes == "base":
            moved = _turned(turned @ (there.rotation.T @ own.rotation), moved)
        parts.append(zero_phase(moved, estimate.bandwidth, run.rate))
    every = np.concatenate([one.t for one in blocks])
    at = np.searchsorted(every, estimate.t - 0.5 / run.rate)
    wrench = np.concatenate(parts)[at]
    to_sensor: Array = there.rotation.T @ own.rotation
    if estimate.axes == "base":
        to_sensor = np.concatenate(axes)[at].transpose(0, 2, 1)
    ours, theirs = (_turned(to_sensor, x) for x in (estimate.wrench, wrench))
    shown = [observable_part(estimate.learned[:, k, k], to_sensor) for k in HALVES]
    better = _better(sensor, ours[:, :3], theirs[:, :3], shown[0])
    better = better or _elsewhere(sensor, ours, theirs, shown[1])
    return MeasuredWrench(sensor, wrench, carried, component_errors(estimate, wrench), better)


def _logged(run: Run, file: LogArgument, sensor: Sensor) -> tuple[Array, Array]:
    """Increasing times from the log's start `(M,)` [s], and the sensor's columns, `(M, 6)`."""
    recording = recording_of(file, run.recording.signals)
    signals = recording.signals
    columns = (signals.time, *sensor.columns)
    rows = np.concatenate(list(recording.log.parts(columns, recording.cut.rows)))
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        wrong = f"no row has numbers in all of {', '.join(sensor.columns)}"
        fix = "name columns of the force/torque sensor with --measured"
        raise DataError(wrong, where=run.name, fix=fix)
    t, first = np.unique(rows[:, 0] * signals.time_scale, return_index=True)
    return t - run.chain.clock.origin, rows[first, 1:]


def _carried(
    identified: IdentifiedModel,
    run: Run,
    start: float,
    blocks: Sequence[Block],
    read: Sequence[Array],
    axes: Sequence[Array],
    sensor: Sensor,
) -> SensorLoad:
    """Bias, and weight if stretches are stated and turn gravity enough, by least squares.

    The window of the log begins at `start` [s].
    """
    t = np.concatenate([block.t for block in blocks])
    speed = np.abs(np.concatenate([block.dq for block in blocks], axis=1))
    moves, stands = run.judged.span[0], bool(np.isinf(run.judged.rest_speed).all())
    if stands and not sensor.rest:
        raise DataError(
            "no joint moves in this log: it does not show where nothing touches the sensor, which "
            "its bias needs",
            where=run.name,
            fix="name a stretch without contact with --sensor-rest START:STOP [s], such as 0:2",
        )
    at: NDArray[np.bool_] = (t >= start) & (t < moves)
    if sensor.rest:
        inside = [(t >= first) & (t < last) for first, last in sensor.rest]
        at = np.logical_or.reduce(inside) & (speed <= run.judged.rest_speed[:, None]).all(axis=0)
    if np.count_nonzero(at) < LEAST_REST * run.rate:
        stated = ", ".join(f"{a:g}:{b:g}" for a, b in sensor.rest)
        raise DataError(
            f"the robot does not rest for {LEAST_REST:g} s in the stated {stated} s"
            if sensor.rest
            else f"the robot moves from {moves:.2f} s on: there is no rest at the start of the log "
            "for the bias of the sensor",
            where=run.name,
            fix="name stretches where the robot rests and nothing touches the sensor with "
            "--sensor-rest START:STOP [s]",
        )
    values, duration = np.concatenate(read)[at], float(np.count_nonzero(at) / run.rate)
    gravity = np.einsum("tij,i->tj", np.concatenate(axes)[at], identified.robot.gravity)
    bias = values.mean(axis=0)
    size = float(np.linalg.norm(identified.robot.gravity))
    # the first moment shows where gravity turns along two directions
    spread = np.linalg.svd(gravity - gravity.mean(axis=0), compute_uv=False)[1]
    if not sensor.rest or size == 0.0 or spread < LEAST_TURN * size * np.sqrt(len(gravity)):
        return SensorLoad(bias, duration)
    columns = np.zeros((len(gravity), 6, 10))
    columns[:, :, :6] = np.eye(6)
    columns[:, :3, 6] = gravity
    columns[:, 3:, 7:] = -np.array([skew(one) for one in gravity])
    fit = np.linalg.lstsq(columns.reshape(-1, 10), values.ravel(), rcond=None)
    solution = np.asarray(fit[0], dtype=np.float64)
    return SensorLoad(solution[:6], duration, float(solution[6]), solution[7:])


def _load(
    identified: IdentifiedModel, block: Block, axes: Array, frame: Frame, carried: SensorLoad
) -> Array:
    """What weight and inertia of the carried body add to what the sensor reads, `(N, 6)`."""
    assert carried.mass is not None and carried.first_moment is not None
    twist = np.einsum("tij,jt->ti", identified.jacobian(block.q.T, frame), block.dq)
    change = np.gradient(twist, block.t, axis=0)
    pull, spin, turn = (
        np.einsum("tij,ti->tj", axes, x)
        for x in (identified.robot.gravity - change[:, :3], change[:, 3:], twist[:, 3:])
    )
    h = carried.first_moment
    force = carried.mass * pull - np.cross(spin, h) - np.cross(turn, np.cross(turn, h))
    return np.hstack([force, np.cross(h, pull)])


def _moved(wrench: Array, frame: Placement, sensor: Placement) -> Array:
    """Wrenches `(N, 6)` about a sensor's origin, along its axes, brought into a frame likewise."""
    turned = _turned(frame.rotation.T @ sensor.rotation, wrench)
    turned[:, 3:] += np.cross(frame.rotation.T @ (sensor.position - frame.position), turned[:, :3])
    return turned


def _turned(rotations: Array, wrench: Array) -> Array:
    """Wrenches `(N, 6)` along other axes, by rotations `(N, 3, 3)`, or one `(3, 3)`."""
    both: Array = np.einsum("...ij,...kj->...ki", rotations, wrench.reshape(-1, 2, 3))
    return both.reshape(-1, 6)


def component_errors(estimate: WrenchEstimate, wrench: Array) -> tuple[ComponentError, ...]:
    """Estimate minus a measured wrench `(N, 6)`, component by component."""
    apart = estimate.wrench - wrench
    sums = np.abs(apart).sum(axis=0)
    deviations = np.abs(wrench - wrench.mean(axis=0)).sum(axis=0)
    inside = np.mean(np.abs(apart) <= estimate.half_width, axis=0)
    return tuple(
        ComponentError(
            component=name,
            unit=unit,
            mean=float(apart[:, k].mean()),
            std=float(apart[:, k].std()),
            relative_absolute=float(sums[k] / deviations[k]) if deviations[k] > 0.0 else None,
            relative=float(sums[k] / size) if (size := np.abs(wrench[:, k]).sum()) > 0.0 else None,
            within_interval=float(inside[k]),
        )
        for k, (name, unit) in enumerate(zip(COMPONENTS, UNITS, strict=True))
    )


QUARTER_TURNS = tuple(
    turn
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(turn := np.diag(signs)[list(order)]) > 0.0
)
"""The 24 rotations that bring axes onto axes."""

HALVES = (slice(0, 3), slice(3, 6))
"""Force and moment of a wrench."""


def observable_part(learned: Array, rotations: Array) -> Array:
    """Projections `(N, 3, 3)` onto the observable directions of a force or a moment.

    Of its share from data, `(N, 3, 3)`, along other axes, by rotations `(N, 3, 3)` or `(3, 3)`.
    """
    values, vectors = np.linalg.eigh(learned)
    turned = rotations @ (vectors * (values >= OBSERVABLE)[:, None, :])
    return np.asarray(turned @ turned.swapaxes(1, 2))


def _better(sensor: Sensor, ours: Array, theirs: Array, shown: Array) -> str:
    """The options of another sign or turn of the sensor with which forces would fit much better.

    Forces are `(N, 3)` along the sensor's axes, compared along observable directions alone, onto
    which `shown`, `(N, 3, 3)`, projects. Tried are the other sign, turns by quarters about
    axes of the sensor or the link, axes along those of the link, any turn [Kabsch1976], and turns
    with the other sign; the simplest of those that fit well is named.
    """

    def left(sign: float, turn: Array) -> float:
        apart = sign * theirs @ turn.T - ours
        return float(np.sum(np.square(np.einsum("tij,tj->ti", shown, apart))))

    ours = np.einsum("tij,tj->ti", shown, ours)
    u, _, v = np.linalg.svd(ours.T @ theirs)
    placed = sensor.placement.rotation
    of_link = (placed.T @ turn @ given for given in (placed, np.eye(3)) for turn in QUARTER_TURNS)
    quarters = (*QUARTER_TURNS, *of_link)
    tiers = [[(-1.0, np.eye(3))]]
    for sign in (1.0, -1.0):
        flip = np.diag([1.0, 1.0, sign * np.linalg.det(u @ v)])
        tiers += [[(sign, turn) for turn in quarters], [(sign, sign * u @ flip @ v)]]
    best = [min(tier, key=lambda one: left(*one)) for tier in tiers]
    sizes = [left(*one) for one in best]
    now, size = left(1.0, np.eye(3)), float(np.sum(np.square(ours)))
    if now < LEAST_APART * size or min(sizes) >= MUCH_BETTER * now:
        return ""
    sign, turn = next(
        one for one, size in zip(best, sizes, strict=True) if size <= AS_GOOD * min(sizes)
    )
    options = []
    if sign < 0.0:
        other = "by_robot" if sensor.sign == "on_robot" else "on_robot"
        options.append(f"--sensor-sign {other}")
    if not np.array_equal(turn, np.eye(3)):
        numbers = replace(sensor, placement=sensor.placement @ Placement(turn)).numbers
        options.append(f'--sensor-at "{" ".join(f"{x:.4g}" for x in numbers)}"')
    rms, would = (significant(float(np.sqrt(x / ours.size)), 2) for x in (now, left(sign, turn)))
    whats = ["another sign"] * (sign < 0.0) + ["other axes"] * (len(options) > (sign < 0.0))
    return (
        f"{' and '.join(whats)} of the sensor would fit much better: with {' '.join(options)} "
        f"forces differ by {would} N (RMS) instead of {rms} N"
    )


def _elsewhere(sensor: Sensor, ours: Array, theirs: Array, shown: Array) -> str:
    r"""The place of the sensor with which moments would fit much better; empty if none.

    Wrenches are `(N, 6)` along the sensor's axes about one point. A sensor that is further by $r$
    have measured moments that lack $r \times F$. Moments are compared along observable directions
    alone, onto which `shown`, `(N, 3, 3)`, projects.
    """
    own, there = (np.einsum("tij,tj->ti", shown, x[:, 3:]) for x in (ours, theirs))
    missing = own - there
    crossed = -(shown @ np.array([skew(one) for one in theirs[:, :3]])).reshape(-1, 3)
    r = np.linalg.lstsq(crossed, missing.ravel(), rcond=None)[0]
    now = float(np.sum(np.square(missing)))
    would = float(np.sum(np.square(missing.ravel() - crossed @ r)))
    if now < LEAST_APART * float(np.sum(np.square(own))) or would >= MUCH_BETTER * now:
        return ""
    if np.linalg.norm(r) > MOST_DISTANCE:  # the sensor measures next to no force
        return ""
    numbers = replace(sensor, placement=sensor.placement @ Placement(np.eye(3), r)).numbers
    some = numbers if any(numbers[3:]) else numbers[:3]
    at = " ".join(f"{round(x, 3) + 0.0:g}" for x in some)
    rms, less = (significant(float(np.sqrt(x / missing.size)), 2) for x in (now, would))
    return (
        f'another place of the sensor would fit much better: with --sensor-at "{at}" moments '
        f"differ by {less} Nm (RMS) instead of {rms} Nm"
    )

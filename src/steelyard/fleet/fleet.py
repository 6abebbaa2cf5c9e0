"""Many robots of one kind over many days: `steelyard fleet`, from logs to what changed and when."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from steelyard.base.arrays import Array, by_key
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.base.workers import refuse_odd
from steelyard.estimate.changes_from_model import LocalParameters, NormalEquations
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.estimator_register import context_of, method_of, offer_of
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.part_information import PartSummary
from steelyard.fleet.changes_over_days import FleetDays
from steelyard.fleet.fleet_result_and_page import Fleet, FleetPlan, Work
from steelyard.fleet.parts_and_first_model import FleetParts, fleet_parts
from steelyard.fleet.scatter_of_days import RobotDays
from steelyard.fleet.shared_bodies import SharedSums, summed
from steelyard.identify.remembered_parts import RememberedParts
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot

FARTHEST_TEMPERATURE = 100.0
"""From the fleet's median, above which a temperature is none of a motor, or in another unit [K]."""
LEAST_EXPLAINED = 0.91  # share of the squared efforts: an error of 30 %
BYTES_OF_PROCESS, BYTES_OF_SAMPLE = 250 << 20, 120
"""Memory of a process without logs, and of a sample of a joint while it is worked on."""


@checked(false_alarms=1e-6, processes=1)
def fleet(
    robot: str | Path | LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    *,
    names: str | None = None,
    temperature: str | Iterable[str] = (),
    false_alarms: float = 1.0,
    store: str | Path | None = None,
    cluster: str | None = None,
    processes: int | None = None,
    progress: Progress = silent,
) -> Fleet:
    """Identify what robots of one kind share, and find which of them changed, in what, since when.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        logs: Logs, folders of logs, patterns with `*`, or URLs (`s3://`, `gs://`); or a table of
            them, CSV with the columns log, robot, day and, if known, temperature.
        names: How robot and day stand in the paths, such as `{robot}/{day}`; found if `None`.
        temperature: Columns of temperatures in the logs: one for all joints, or one a joint.
        false_alarms: Changes that are named by chance in a year of the whole fleet, on average.
        store: Folder or URL that remembers the work; the cache's if `None`.
        cluster: Address of a Dask scheduler, `tcp://HOST:PORT`, or `local:N` for N workers here.
        processes: Processes of this machine without a cluster; its cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or no log can.

    Example:
        >>> found = fleet("arm.toml", "fleet-logs", names="{robot}/{day}")
        >>> found.changes
        ()
    """
    refuse_odd(cluster)
    began, loaded = perf_counter(), load_robot(robot)
    with fleet_parts(loaded, logs, names, temperature, store, progress) as of_fleet:
        found = of_fleet.remembered
        missing = found.missing()
        found.make(missing, cluster, processes or os.cpu_count() or 1, progress)
        made = Work(len(found.parts), len(missing), found.memory.damaged)
        return _judged(loaded, of_fleet, false_alarms, made, began, progress)


@checked(processes=1)
def plan_fleet(
    robot: str | Path | LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    *,
    names: str | None = None,
    temperature: str | Iterable[str] = (),
    store: str | Path | None = None,
    processes: int | None = None,
    progress: Progress = silent,
) -> FleetPlan:
    """How much work `fleet` has to do: parts, bytes, time and memory, measured on one part.

    The first model is identified, and one part is worked on, unless both are remembered; they are
    remembered then.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        logs: As of `fleet`.
        names: As of `fleet`.
        temperature: As of `fleet`.
        store: As of `fleet`.
        processes: As of `fleet`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or no log can.

    Example:
        >>> plan_fleet("arm.toml", "fleet-logs", names="{robot}/{day}").robots
        2
    """
    loaded, cores = load_robot(robot), processes or os.cpu_count() or 1
    with fleet_parts(loaded, logs, names, temperature, store, progress) as of_fleet:
        found = of_fleet.remembered
        missing = found.missing()
        size = sum(found.parts[k].size for k in missing)
        if missing:
            largest = max(missing, key=lambda k: found.parts[k].size)
            found.make([largest], None, 1, progress)
            missing.remove(largest)
            one, _ = found.read(largest)
            left = size - found.parts[largest].size
            seconds = one.seconds * left / max(found.parts[largest].size, 1) / cores
            rows = one.samples
        else:
            seconds, rows, left = 0.0, 0, 0
        return FleetPlan(
            parts=len(found.parts),
            left=len(missing),
            robots=len({part.robot for part in found.parts}),
            days=len({part.day for part in found.parts}),
            bytes=sum(part.size for part in found.parts),
            bytes_left=left,
            processes=cores,
            seconds=seconds,
            memory=cores
            * (BYTES_OF_PROCESS + rows * len(found.reference.joints) * BYTES_OF_SAMPLE),
        )


def _judged(
    loaded: LoadedRobot,
    of_fleet: FleetParts,
    false_alarms: float,
    made: Work,
    began: float,
    progress: Progress,
) -> Fleet:
    """Changes from the model that robots share, which itself is found beside their changes."""
    found = of_fleet.remembered
    model, used = found.reference, list[int]()
    for last in (False, True):
        local = LocalParameters(model, found.regressor.layout)
        summaries, equations, left_out, used = found.counted(local, progress)
        by_robot = by_key((found.parts[k].robot, k) for k in used)
        robots = [
            _days_of(name, mine, found, summaries, equations) for name, mine in by_robot.items()
        ]
        robots, unwarm = _plausible(robots)
        report_progress(progress, "looking for changes", int(last), 2)
        days = FleetDays(robots, local, false_alarms)
        if not last:
            model = _shared(loaded, found, days, by_robot, summaries, progress)
    return Fleet(
        robot=model.robot.name,
        model=model,
        days=days,
        changes=days.changes,
        levels=days.levels,
        left_out=tuple(left_out.values()),
        remarks=_remarks(of_fleet, local, equations, used, unwarm),
        work=replace(
            made,
            samples=sum(summaries[k].samples for k in used),
            seconds=perf_counter() - began,
        ),
    )


def _remarks(
    of_fleet: FleetParts,
    local: LocalParameters,
    equations: Sequence[NormalEquations | None],
    used: Sequence[int],
    unwarm: Sequence[str],
) -> tuple[str, ...]:
    """What qualifies the whole result."""
    said = [
        str(doubt["says"])
        for doubt in of_fleet.remembered.reference.provenance.doubts
        if "says" in doubt
    ]
    known = [e for k, e in enumerate(equations) if k in set(used) and e is not None]
    left = sum(local.unexplained(e) * float(e.counts.sum()) for e in known)
    share = 1.0 - left / max(float(sum(e.effort.sum() for e in known)), 1e-300)
    if share < LEAST_EXPLAINED:
        said.append(
            f"the model explains {100.0 * max(share, 0.0):.0f} % of the squared efforts, even with "
            "changes of every robot: is the robot file that of these robots? `steelyard check` "
            "with one of the logs names what differs"
        )
    if unwarm:
        more = f", and {len(unwarm) - 3} more" if len(unwarm) > 3 else ""
        said.append(
            f"no plausible temperature on {', '.join(unwarm[:3])}{more}: the average is assumed"
        )
    if of_fleet.nameless:
        more = f", and {len(of_fleet.nameless) - 1} more" if len(of_fleet.nameless) > 1 else ""
        said.append(f"not read, as a robot's day is not known: {of_fleet.nameless[0]}{more}")
    return tuple(said)


def _days_of(
    robot: str,
    mine: Sequence[int],
    found: RememberedParts,
    summaries: Sequence[PartSummary],
    equations: Sequence[NormalEquations | None],
) -> RobotDays:
    by_day, sums, warm = by_key((found.parts[k].day, k) for k in mine), [], []
    for numbers in by_day.values():
        known = [equations[k] for k in numbers]
        total = known[0]
        for one in known[1:]:
            total = total + one  # type: ignore[operator]  # those that are used have sums
        sums.append(total)
        warm.append(_temperature(numbers, found, summaries))
    return RobotDays(robot, tuple(by_day), tuple(filter(None, sums)), np.array(warm))


def _temperature(
    numbers: Sequence[int], found: RememberedParts, summaries: Sequence[PartSummary]
) -> Array:
    """Mean temperatures of a day's parts, those of columns or of the table; NaN if not known."""
    if found.work.temperature:
        each = np.array([summaries[k].temperature for k in numbers])
    elif any(part.temperature is not None for part in found.parts):
        told = (found.parts[k].temperature for k in numbers)
        each = np.array([[np.nan if one is None else one] for one in told])
    else:
        return np.zeros(0)
    known = np.isfinite(each)
    count = known.sum(axis=0)
    total = np.where(known, each, 0.0).sum(axis=0)
    mean = np.divide(total, count, out=np.full(each.shape[1], np.nan), where=count > 0)
    return np.asarray(mean, dtype=np.float64)


def _plausible(robots: Sequence[RobotDays]) -> tuple[list[RobotDays], tuple[str, ...]]:
    """The days without temperatures that none of a motor is beside the others, and which."""
    every = np.concatenate([robot.temperature for robot in robots])
    if not every.size:
        return list(robots), ()
    if not np.isfinite(every).any():
        raise LogError(
            "no log has a temperature in these columns",
            where="temperature (--temperature)",
            fix="name columns of the logs; `steelyard log info LOG` lists them",
        )
    known = (column[np.isfinite(column)] for column in every.T)
    usual = np.array([np.median(x) if len(x) else np.nan for x in known])
    found, said = list[RobotDays](), list[str]()
    for robot in robots:
        far = np.abs(robot.temperature - usual) > FARTHEST_TEMPERATURE
        odd = far.any(axis=1) | np.isnan(robot.temperature).any(axis=1)
        said += [f"{robot.robot} {robot.days[k]}" for k in np.flatnonzero(odd)]
        found.append(replace(robot, temperature=np.where(far, np.nan, robot.temperature)))
    return found, tuple(said)


def _shared(
    loaded: LoadedRobot,
    found: RememberedParts,
    days: FleetDays,
    by_robot: dict[str, list[int]],
    summaries: Sequence[PartSummary],
    progress: Progress,
) -> IdentifiedModel:
    """The model of all robots and days before their first change."""
    scatter, sums = days.scatter, list[Information]()
    for number, (robot, own) in enumerate(zip(days.robots, by_robot.values(), strict=True)):
        report_progress(progress, "shared model", number, len(by_robot))
        kept = set(robot.days[: days.first_change(number)])
        warm = dict(zip(robot.days, days.at_middle(robot, scatter), strict=True))
        one = SharedSums(days.local, scatter.day, scatter.robot)
        for k in own:
            if found.parts[k].day in kept:
                information = found.read(k)[1]
                assert information is not None
                one.add(information, warm[found.parts[k].day])
        sums.append(one.information(robot.robot))
    fastest = np.max([summaries[k].fastest for mine in by_robot.values() for k in mine], axis=0)
    estimate = _estimate(loaded, found, summed(sums), fastest, progress)
    origin, n = found.reference.provenance, len(sums)
    inputs = {k: v for k, v in origin.inputs.items() if not k.startswith("identification ")}
    of_robots = {
        f"identification {found.parts[k].file.name} ({found.parts[k].robot})": found.of.digests[k]
        for mine in by_robot.values()
        for k in mine
    }
    words = f"parameters of {n} robots over {days.n_days} days, see fleet.json"
    says = f"the model is that of {n} robots: each one has friction of its own, which errors of "
    says += "efforts contain, and a drift from the model is no change of the robot"
    doubt = {"check": "fleet", "log": "", "severity": "DOUBTFUL", "says": says, "figure": "",
           "fix": "", "brief": ""}  # fmt: skip
    provenance = replace(
        origin,
        inputs=inputs | of_robots,
        runs=(),
        notes=(*origin.notes, words),
        doubts=(*origin.doubts, doubt),
    )
    return replace(found.reference, estimate=estimate, provenance=provenance)


def _estimate(
    loaded: LoadedRobot,
    found: RememberedParts,
    information: Information,
    fastest: Array,
    progress: Progress,
) -> Estimate:
    """The estimate by the robot file's method, or by least squares where it needs samples."""
    method = method_of(loaded)
    if method.needs != "information":
        method = offer_of("WLS", "fleet")
    context = context_of(loaded, found.regressor, fastest, progress)
    return method.make(context)(information)

"""Ways to spoil what a log holds: scales, orders, delays, clocks, rows, noise."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from proofs.support.mistakes import COLUMNS, RATE, Arm, Job, Log
from scipy.signal import butter, lfilter

from steelyard.base.arrays import Array
from steelyard.base.motion import Motion


def efforts(change: Callable[[Log], Array]) -> Callable[[Arm], Job]:
    """All logs with other efforts."""
    return lambda arm: arm.plain().every(lambda log: replace(log, tau=change(log)))


def scaled(what: str, factor: float, joint: int | None = None) -> Callable[[Arm], Job]:
    """All logs with a signal of all joints, or of one, scaled; see `Arm.joint`."""

    def plant(arm: Arm) -> Job:
        n = arm.robot.n
        which = slice(None) if joint is None else arm.joint(joint)
        factors = np.ones(n)
        factors[which] = factor

        def change(log: Log) -> Log:
            parts = {"q": ("q", "dq"), "dq": ("dq",), "tau": ("tau",), "positions": ("q",)}[what]
            return replace(log, **{part: getattr(log, part) * factors for part in parts})

        return arm.plain().every(change)

    return plant


def reordered(order: Sequence[int], *what: str) -> Callable[[Arm], Job]:
    """All logs with signals in another order."""

    def change(log: Log) -> Log:
        return replace(log, **{name: getattr(log, name)[:, list(order)] for name in what})

    return lambda arm: arm.plain().every(change)


def clock(factor: float, *, velocities: bool = True) -> Callable[[Arm], Job]:
    """All logs with a clock that runs wrong."""

    def change(log: Log) -> Log:
        return replace(log, t=log.t * factor, dq=log.dq if velocities else None)

    return lambda arm: without_velocities(arm.plain().every(change), not velocities)


def without_velocities(job: Job, without: bool = True) -> Job:
    """The job without velocity columns."""
    if not without:
        return job
    bare = job.toml('velocity = "dq{}_rad_s"\n', "")
    return bare.every(lambda log: replace(log, dq=None))


def late(seconds: float, *what: str) -> Callable[[Arm], Job]:
    """All logs with signals that were logged late."""

    def shifted(log: Log, name: str) -> Array:
        values = getattr(log, name)
        return np.column_stack([np.interp(log.t - seconds, log.t, c) for c in values.T])

    def change(log: Log) -> Log:
        return replace(log, **{name: shifted(log, name) for name in what})

    return lambda arm: arm.plain().every(change)


def backward_difference(log: Log) -> Log:
    """Velocities made of this row and the one before."""
    dq = np.vstack([np.zeros((1, log.q.shape[1])), np.diff(log.q, axis=0)]) * RATE
    return replace(log, dq=dq)


def resampled(log: Log) -> Log:
    """A tenth of the rows lost in stretches, and the stamps made uniform."""
    rng = np.random.default_rng(len(log.t))
    keep = np.ones(len(log.t), dtype=bool)
    for start in rng.integers(100, len(log.t) - 100, 40):
        keep[start : start + 10] = False
    kept = log.rows(keep)
    return replace(kept, t=np.arange(len(kept.t)) / RATE)


def spoiled_rows(log: Log, kind: str) -> Log:
    """Rows that are repeated, lost, out of order, stamped badly, or without numbers."""
    rng = np.random.default_rng(3)
    count = len(log.t)
    some = np.sort(rng.choice(np.arange(1, count - 1), count // 30, replace=False))
    if kind == "repeated":
        twice = np.sort(np.concatenate([np.arange(count), some]))
        return log.rows(twice)
    if kind == "gap":
        return log.rows(np.r_[0:1500, 1560:2600, 2700:count])
    if kind == "order":
        order = np.arange(count)
        order[some], order[some + 1] = some + 1, some
        return log.rows(order)
    if kind == "jitter":
        return replace(log, t=np.sort(log.t + 0.004 * rng.standard_normal(count)))
    tau = log.tau.copy()
    if kind == "nan":
        tau[some] = np.nan
    else:
        tau[some[::6], 2] += 400.0
    return replace(log, tau=tau)


def rows(kind: str) -> Callable[[Arm], Job]:
    """All logs with bad rows."""
    return lambda arm: arm.plain().every(lambda log: spoiled_rows(log, kind))


def every(change: Callable[[Log], Log]) -> Callable[[Arm], Job]:
    """All logs changed."""
    return lambda arm: arm.plain().every(change)


def velocity_of_another(log: Log) -> Log:
    """The velocity of joint 4 in the columns of joints 4 and 5."""
    if log.dq is None:
        raise ValueError("the log has no velocities")
    dq = log.dq.copy()
    dq[:, 4] = dq[:, 3]
    return replace(log, dq=dq)


def saturated(arm: Arm) -> Job:
    """Efforts that end at half of their range."""
    top = 0.5 * np.abs(arm.torque(arm.motion(9))).max(axis=0)
    return arm.plain().every(lambda log: replace(log, tau=np.clip(log.tau, -top, top)))


def smoothed(log: Log) -> Log:
    """Efforts through a first-order low-pass of 2 Hz."""
    b, a = butter(1, 2.0, fs=RATE)
    return replace(log, tau=lfilter(b, a, log.tau, axis=0))


def commanded(arm: Arm) -> Job:
    """Positions and velocities as they were commanded, 30 ms before they were reached."""

    def log(k: int) -> Log:
        commanded = arm.motion(k)
        shifted = [
            np.column_stack([np.interp(commanded.t - 0.03, commanded.t, c) for c in x.T])
            for x in (commanded.q, commanded.dq, commanded.ddq)
        ]
        real = arm.log(Motion(commanded.t, *shifted), k)
        return replace(real, q=commanded.q, dq=commanded.dq)

    logs = [log(k) for k in range(3)]
    return Job((logs[0], logs[1]), logs[2], arm.robot_file, arm.urdf)


def motionless(arm: Arm, *, truly: bool) -> Job:
    """A joint that never moves; or its position column alone that stays as it is."""
    joint = arm.joints[0]

    def log(k: int) -> Log:
        m = arm.motion(k)
        parts = [x.copy() for x in (m.q, m.dq, m.ddq)]
        for x in parts:
            x[:, joint] = 0.0
        still = Motion(m.t, *parts)
        return arm.log(still, k, None if truly else arm.torque(m))

    logs = [log(k) for k in range(3)]
    return Job((logs[0], logs[1]), logs[2], arm.robot_file, arm.urdf)


def small(arm: Arm) -> Job:
    """Motions of a few hundredths of a radian."""

    def log(k: int) -> Log:
        m = arm.motion(k)
        return arm.log(Motion(m.t, *(0.02 * x for x in (m.q, m.dq, m.ddq))), k)

    logs = [log(k) for k in range(3)]
    return Job((logs[0], logs[1]), logs[2], arm.robot_file, arm.urdf)


def two_rates(arm: Arm) -> Job:
    """The second log has half as many rows a second."""
    job = arm.plain()
    return replace(job, fitted=(job.fitted[0], job.fitted[1].rows(slice(None, None, 2))))


def named(job: Job, *names: str) -> Job:
    """The logs with other column names, and no robot file."""
    time, position, velocity, effort = names or COLUMNS
    return replace(job, robot_file="", columns=(time, position, velocity, effort))

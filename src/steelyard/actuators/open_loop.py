"""How well targets alone predict positions: over whole logs, and from measured states on."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.read_targets import TargetLog
from steelyard.actuators.rollout import STEP, rollouts
from steelyard.actuators.target_runs import TargetRun, Window, windows_of
from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.model.equations.inverse_dynamics import carried_point
from steelyard.robot.robot import Robot

AFTER = (0.1, 0.5, 2.0)
"""Times after a measured state at which the drift is judged [s]."""


@dataclass(frozen=True, eq=False)
class Drift:
    """Errors some time after a measured state, as root mean squares over all starts."""

    after: float
    rms: Array
    tool: float
    """Of the tool's place [m]."""


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """Errors of a log's positions, predicted from its targets alone.

    Attributes:
        log: Name of the log.
        seconds: Its length.
        rms: Over the whole log, `(n,)` [rad; m].
        tool: Of the tool's place [m].
        target_rms: Of "position = target", `(n,)`.
        target_tool: Of the tool's place if it were where targets put it [m].
        drift: Some times after measured states.
        t: Times of the runs [s].
        q: Measured positions `(N, n)`.
        predicted: Predicted positions.
        target: Targets.
    """

    log: str
    seconds: float
    rms: Array
    tool: float
    target_rms: Array
    target_tool: float
    drift: tuple[Drift, ...]
    t: Array
    q: Array
    predicted: Array
    target: Array

    def to_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        """The errors as JSON values, by joint."""

        def named(x: Array) -> dict[str, float]:
            return dict(zip(joints, x.tolist(), strict=True))

        return {
            "rms": named(self.rms),
            "tool_m": self.tool,
            "drift": [
                {"after_s": one.after, "rms": named(one.rms), "tool_m": one.tool}
                for one in self.drift
            ],
            "position_is_target": {"rms": named(self.target_rms), "tool_m": self.target_tool},
        }


def open_loops(
    step: ArmStep, values: ActuatorValues, logs: Sequence[TargetLog], threads: int, h: float = STEP
) -> tuple[OpenLoop, ...]:
    """Logs predicted from their first rows on, each of their runs by itself, all side by side."""
    windows = [windows_of(log.runs, None) for log in logs]
    rolled = iter(rollouts(step, values, [w for some in windows for w in some], (), h, threads))
    return tuple(
        _open_loop(step, values, log, [next(rolled).q for _ in some], threads, h)
        for log, some in zip(logs, windows, strict=True)
    )


def _open_loop(
    step: ArmStep,
    values: ActuatorValues,
    log: TargetLog,
    runs: Sequence[Array],
    threads: int,
    h: float,
) -> OpenLoop:
    """The errors of one log, from the positions that are predicted of its runs."""
    predicted = np.concatenate(runs)
    if not np.isfinite(predicted).all():
        raise LogError(
            "the simulation from targets diverges",
            where=log.name,
            fix="check targets and positions of the log, and what the model says of its actuators",
        )
    t, q, target = (
        np.concatenate([getattr(run, name) for run in log.runs]) for name in ("t", "q", "target")
    )
    robot = step.model.robot
    here, there, meant = (
        tool_place(robot, values.signs * x + values["zero"]) for x in (q, predicted, target)
    )
    return OpenLoop(
        log.name,
        log.seconds,
        _rms(predicted - q),
        float(np.sqrt(((there - here) ** 2).sum(axis=1).mean())),
        _rms(target - q),
        float(np.sqrt(((meant - here) ** 2).sum(axis=1).mean())),
        tuple(_drifts(step, values, log.runs, threads, h)),
        t,
        q,
        predicted,
        target,
    )


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


def _drifts(
    step: ArmStep, values: ActuatorValues, runs: Sequence[TargetRun], threads: int, h: float
) -> list[Drift]:
    """Windows of the longest time, each begun as it was measured."""
    windows = windows_of(runs, AFTER[-1])
    rolled = rollouts(step, values, windows, (), h, threads)
    found = []
    for after in AFTER:
        rows = [(w, r, _row(w, after)) for w, r in zip(windows, rolled, strict=True)]
        rows = [row for row in rows if row[2] >= 0]
        if not rows:
            continue
        measured = np.array([w.q[k] for w, _, k in rows])
        simulated = np.array([r.q[k] for _, r, k in rows])
        robot = step.model.robot
        places = [
            tool_place(robot, values.signs * x + values["zero"]) for x in (measured, simulated)
        ]
        off = ((places[1] - places[0]) ** 2).sum(axis=1)
        found.append(Drift(after, _rms(simulated - measured), float(np.sqrt(off.mean()))))
    return found


def _row(window: Window, after: float) -> int:
    """The row nearest to a time after the window's start; -1 if it is not in it."""
    t = window.t - window.t[0]
    row = int(np.argmin(np.abs(t - after)))
    step = float(np.median(np.diff(t)))
    return row if abs(t[row] - after) <= step else -1


def tool_body(robot: Robot) -> int:
    """The body that most joints carry."""
    return max(range(len(robot.bodies)), key=lambda k: len(robot.carriers(k)))


def tool_place(robot: Robot, q: Array) -> Array:
    """Where the origin of the last body's frame is, `(N, 3)` [m], at positions `(N, n)`."""
    place, _ = carried_point(robot, list(q.T), tool_body(robot), np.zeros(3))
    return np.stack([np.broadcast_to(x, len(q)) for x in place], axis=1).astype(float)

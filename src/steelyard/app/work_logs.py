"""Work on a log in a process: its columns as the robot file declares them, thinned for pictures."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.progress import Progress, report_progress
from steelyard.logs.formats import open_log
from steelyard.report.page import packed
from steelyard.report.page_figures import Figure, drawn, line
from steelyard.report.words import significant
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.recording import Recording
from steelyard.runs.runs_of_named_logs import log_file, recording_of, signals_of

MOST_COLUMNS, LONGEST_COLUMN = 1000, 200  # columns to choose from, letters of the name of one
MOST_ROWS = 20_000  # rows of a log that are kept for pictures
MOST_POINTS = 1000  # points of a curve
MOST_FRAMES = 3000  # postures of a replay
COLOURS = ("--blue", "--vermillion", "--green", "--purple", "--amber", "--arm")


def columns(log: str, progress: Progress) -> dict[str, Any]:
    """Names of the columns of a log to choose from, and how many there are more."""
    found = open_log(log_file(log).path)
    names = list(dict.fromkeys(found.columns))
    offered = [name for name in names if len(name) <= LONGEST_COLUMN][:MOST_COLUMNS]
    return {"columns": offered, "more": len(names) - len(offered)}


def preview(robot: str, log: str, progress: Progress) -> dict[str, Any]:
    """Positions and efforts of a log as declared, as curves and as a motion of the arm."""
    loaded = load_robot(robot)
    argument = log_file(log)
    signals, reasons = signals_of(loaded, argument)
    recording = recording_of(argument, signals)
    t, x, rows = _thinned(recording, progress)
    channels, arm = recording.channels, loaded.robot
    start = float(t[0])
    t = t - start
    names = arm.joint_names[channels.base :]
    q, effort = x[:, channels.encoders], x[:, channels.effort][:, channels.base :]
    units = tuple(dict.fromkeys(c.unit for c in arm.coordinates[channels.base :]))
    figures = [
        _figure("Positions", f"position [{', '.join(units)}]", names, t, q),
        _figure(
            "Efforts",
            f"effort [{', '.join(dict.fromkeys(signals.effort_units))}]",
            names,
            t,
            effort,
        ),
    ]
    frames = slice(None, None, -(-len(t) // MOST_FRAMES))
    whole = np.nan_to_num(x[frames, channels.q])
    return {
        "figures": figures,
        "motion": {"t": packed(t[frames]), "q": packed(whole.ravel())},
        "rows": rows,
        "duration": float(t[-1]),
        "beyond": _beyond(names, q, arm.coordinates[channels.base :]),
        "reasons": list(reasons),
        "signals": loaded.signals is not None,
    }


@dataclass
class _Kept:
    """Every `step`-th row; the step doubles when there are too many."""

    step: int = 1
    seen: int = 0
    t: list[Array] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)

    def add(self, t: Array, x: Array) -> None:
        """Keep rows of a part."""
        first = -self.seen % self.step
        self.t.append(t[first :: self.step])
        self.x.append(x[first :: self.step])
        self.seen += len(t)
        while sum(map(len, self.t)) > MOST_ROWS:
            self.step *= 2
            self.t = [np.concatenate(self.t)[::2]]
            self.x = [np.concatenate(self.x)[::2]]


def _thinned(recording: Recording, progress: Progress) -> tuple[Array, Array, int]:
    """Times `(N,)` [s], channels `(N, C)` in SI units of some rows, and how many rows there are."""
    kept = _Kept()
    for t, x in recording.raw((0, None)):
        kept.add(t, x)
        report_progress(progress, "reading the log", float(kept.seen), 0.0)
    recording.in_memory(1)  # a log without rows is refused
    return np.concatenate(kept.t), np.concatenate(kept.x), kept.seen


def _figure(label: str, y: str, names: tuple[str, ...], t: Array, x: Array) -> str:
    lines = []
    for k, name in enumerate(names):
        dash = "solid" if k < len(COLOURS) else "dot"
        lines.append(
            line(
                name,
                *drawn(t, x[:, k], MOST_POINTS),
                COLOURS[k % len(COLOURS)],
                width=1.4,
                dash=dash,
            )
        )
    return str(Figure(label, f"{label} over time", "time [s]", y, lines).json)


def _beyond(names: tuple[str, ...], q: Array, joints: Any) -> list[str]:
    """Joints whose positions leave the limits of the model."""
    found = []
    for name, values, joint in zip(names, q.T, joints, strict=True):
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        limits = joint.limits
        if low < limits.lower or high > limits.upper:
            moved = f"{significant(low)} to {significant(high)} {joint.unit}"
            allowed = f"{significant(limits.lower)} to {significant(limits.upper)} {joint.unit}"
            found.append(f"{name} moves from {moved}, beyond its limits {allowed}")
    return found

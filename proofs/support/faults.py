"""Faults put into clean logs and robot files, for the proof of the checks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.check.all_checks import Diagnosis, examine
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.finding import Edit
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.file.signals import Signals
from steelyard.robot.file.toml_edits import edited
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording


@dataclass(frozen=True, eq=False)
class Clean:
    """A log without fault, and what is known of its robot.

    Attributes:
        robot: Its name.
        name: The log's.
        path: A robot file; it is not written to.
        text: What it says.
        columns: Columns of the log.
        table: Its rows, shape `(N, columns)`.
        reference: Identified from other logs.
        delay: By how much its efforts are late as they are [s].
        misfits: Error of the reference on it, per joint.
    """

    robot: str
    name: str
    path: Path
    text: str
    columns: tuple[str, ...]
    table: np.ndarray
    reference: IdentifiedModel
    delay: float = 0.0
    misfits: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def loaded(self) -> LoadedRobot:
        """The robot file, read."""
        return load_robot(self.path, self.text)

    @property
    def signals(self) -> Signals:
        """What the robot file says about the log."""
        signals = self.loaded.signals
        if signals is None:
            raise ValueError(f"{self.path} says nothing about logs")
        return signals

    def places(self, columns: Sequence[str]) -> list[int]:
        """Where columns are."""
        return [self.columns.index(c) for c in columns]


@dataclass(frozen=True, eq=False)
class Faulty:
    """A log with one fault.

    Attributes:
        text: The robot file.
        table: The log.
        suspects: The checks of which one should say so.
        least: What it should say at least: 2 is wrong, 1 doubtful.
        corrected: Whether the correct is right; `None`: the corrected file reads the faulty log as
            the clean file reads the clean one.
        tolerance: Relative error of each joint's effort that is so read.
    """

    text: str
    table: np.ndarray
    suspects: tuple[str, ...]
    least: int = 2
    corrected: Callable[[Clean, Diagnosis], bool] | None = None
    tolerance: np.ndarray | float = 1e-6


def diagnosis(clean: Clean, text: str, table: np.ndarray) -> Diagnosis:
    """Everything that the checks say of a log."""
    loaded = load_robot(clean.path, text)
    if loaded.signals is None:
        raise ValueError(f"{clean.path} says nothing about logs")
    log = LogInMemory(Path(clean.name), clean.columns, table)
    recording = Recording(log, loaded.signals)
    wanted = loaded.processing
    processing = Processing(
        motion_cutoff=wanted.motion_cutoff, matched_cutoff=wanted.matched_cutoff
    )
    checked = CheckedLog(recording, processing, clean.name)
    return examine(Case(loaded, (checked,), clean.reference))


def right_verdict(faulty: Faulty, found: Diagnosis) -> bool:
    """Whether a check that should says so, and no other one says wrong."""
    hits = [f for f in found.findings if f.check in faulty.suspects]
    others = [f for f in found.findings if f.check not in faulty.suspects]
    return any(f.severity >= faulty.least for f in hits) and all(f.severity < 2 for f in others)


def right_fix(clean: Clean, faulty: Faulty, found: Diagnosis) -> bool:
    """Whether the corrected robot file reads the faulty log as the clean one was read."""
    if faulty.corrected is not None:
        return faulty.corrected(clean, found)
    return reads_alike(clean, faulty, edited(faulty.text, found.edits))


def reads_alike(clean: Clean, faulty: Faulty, text: str) -> bool:
    """Positions, joint efforts and gravity of the two readings."""
    before, after = clean.loaded, load_robot(clean.path, text)
    if not np.allclose(before.robot.gravity, after.robot.gravity, atol=0.02):
        return False
    t, q, dq, tau = joint_values(clean.columns, clean.table, before)
    t2, q2, dq2, tau2 = joint_values(clean.columns, faulty.table, after)
    error = np.linalg.norm(tau2 - tau, axis=0) / np.maximum(np.linalg.norm(tau, axis=0), 1e-12)
    same_dq = dq is None or dq2 is None or np.allclose(dq, dq2, rtol=1e-6, atol=1e-9)
    return bool(
        np.allclose(t, t2, rtol=1e-9, atol=1e-9)
        and np.allclose(q, q2, rtol=1e-9, atol=1e-9)
        and same_dq
        and np.all(error <= faulty.tolerance)
    )


def joint_values(columns: tuple[str, ...], table: np.ndarray, loaded: LoadedRobot) -> Any:
    """Time, positions, velocities and joint efforts."""
    signals = loaded.signals
    if signals is None:
        raise ValueError("the robot file says nothing about logs")
    recording = Recording(LogInMemory(Path("log"), columns, table), signals)
    c = recording.channels
    parts = list(recording.raw((0, None)))
    t, x = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    dq = x[:, c.dq] if c.velocities else None
    return t, x[:, c.q], dq, x[:, c.effort] * signals.gains


def with_keys(text: str, **keys: Any) -> str:
    """A robot file with keys of `[signals.effort]` changed."""
    return edited(text, [Edit(("signals", "effort", k), v) for k, v in keys.items()])


@dataclass
class Tally:
    """Results of the draws of one kind."""

    verdicts: int = 0
    fixes: int = 0
    count: int = 0
    missed: list[str] = field(default_factory=list)

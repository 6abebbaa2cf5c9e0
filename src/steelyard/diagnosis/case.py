"""What is checked: a robot, logs of it, and perhaps a model from clean runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.formats.log import Log, Rows
from steelyard.measurement import Processing, Recording, Run, prepare
from steelyard.measurement.recording import Channels, Samples
from steelyard.measurement.rows.clock import rows_between
from steelyard.progress import Progress, silent
from steelyard.robot_file.loaded import LoadedRobot

EXCERPT = 100_000
"""Rows of a log that are looked at one by one."""
FEWEST = 50
"""Rows of the shortest window in seconds that is looked at alone. If there are fewer, the clock may
be misread, which only the whole log shows."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """One log as the robot file reads it; whatever takes time is computed once, on first use.

    Attributes:
        recording: The log, with the signals that the robot file declares or that were guessed.
        processing: How it is made a run.
        name: The log's name.
    """

    recording: Recording
    processing: Processing
    name: str

    @property
    def log(self) -> Log:
        """The table itself, with all its columns, declared or not."""
        return self.recording.log

    @property
    def channels(self) -> Channels:
        """Order of the channels in `excerpt`."""
        return self.recording.channels

    @cached_property
    def window(self) -> tuple[int, int]:
        """Start and stop of the rows that are looked at one by one; the log may end before."""
        start, stop = self._cut_rows()
        return start, start + EXCERPT if stop is None else min(stop, start + EXCERPT)

    def _cut_rows(self) -> Rows:
        """The cut in rows."""
        cut = self.recording.cut
        if not np.isfinite(cut.seconds).any():
            return cut.rows
        try:
            start, stop = rows_between(self.recording, cut.seconds, EXCERPT)
        except LogError:
            return cut.rows
        return (start, stop) if stop - start >= FEWEST else cut.rows

    @cached_property
    def rows(self) -> tuple[Array, Array]:
        """Time `(N,)` [s] and channels `(N, C)` of the rows of `window`.

        In the SI units that the robot file declares, broken rows included.
        """
        parts = list(self.recording.raw(self.window))
        if not parts:
            return np.zeros(0), np.zeros((0, self.channels.count))
        return np.concatenate([t for t, _ in parts]), np.concatenate([x for _, x in parts])

    @property
    def samples(self) -> Samples:
        """The same rows by name."""
        t, x = self.rows
        c = self.channels
        return Samples(t, x[:, c.q], x[:, c.dq] if c.velocities else None, x[:, c.effort])

    @cached_property
    def run(self) -> Run | LogError:
        """The clean run of all that was logged, no mean over repetitions; or why there is none."""
        try:
            return prepare(self.recording, replace(self.processing, repetitions=None))
        except LogError as error:
            return error


@dataclass(frozen=True, eq=False)
class Case:
    """All that a check may look at.

    Attributes:
        loaded: The robot and what its file says.
        logs: The logs, in the order given.
        reference: A model identified from clean runs; without it the robot's nominal model is all
            that is known beforehand.
        guesses: Columns of the logs that the robot file does not use, by what they seem to hold:
            `velocity` to the columns' names in joint order.
        progress: Told about long work.
    """

    loaded: LoadedRobot
    logs: tuple[Evidence, ...]
    reference: IdentifiedModel | None = None
    guesses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    progress: Progress = silent

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the columns."""
        return self.loaded.robot.joint_names

    def listed(self, joints: Sequence[int]) -> str:
        """Names of joints in a sentence, given by number; of three or more that are all, none."""
        if len(joints) > 2 and len(joints) == len(self.joints):
            return f"all {len(joints)} joints"
        return ", ".join(self.joints[j] for j in joints)

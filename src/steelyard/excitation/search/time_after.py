"""How much of a design's time is kept for what comes after the search.

The certificate, the report and the files take processor time that is known before the search; how
long that is by the clock depends on what else the machine does.
"""

import time
from dataclasses import dataclass, field

import numpy as np

from steelyard.excitation.problem import Problem

RESERVE = 1.4
"""What the certificate, the report and the files take of the processor's time [s]."""

LOOKS = 50.0
"""What they take beyond that, in times that a look at the motion takes."""

MOST = 0.25
"""Share of the whole time that is kept for them at most."""


@dataclass(frozen=True)
class Pace:
    """How fast this process gets on since the pace was made: other programs slow it down.

    Attributes:
        clock: Of `time.monotonic` [s].
        processor: Of `time.process_time` [s].
    """

    clock: float = field(default_factory=time.monotonic)
    processor: float = field(default_factory=time.process_time)

    @property
    def slower(self) -> float:
        """Seconds of the clock for one of the processor; 1 at least."""
        processor = max(time.process_time() - self.processor, 1e-3)
        return max((time.monotonic() - self.clock) / processor, 1.0)


def time_after(problem: Problem, seconds: float, pace: Pace) -> float:
    """Time to keep for what comes after the search [s].

    Args:
        problem: What is designed.
        seconds: Of the whole design.
        pace: Of the process so far.
    """
    return min(pace.slower * (RESERVE + LOOKS * _look(problem)), MOST * seconds)


def _look(problem: Problem) -> float:
    """Processor time that it takes to find out what a motion shows [s], with its code there."""
    still = problem.basis.still(np.zeros(problem.robot.n))
    problem.objective(still, 1.0)
    problem.criterion_value(still)
    start = time.process_time()
    problem.criterion_value(still)
    return time.process_time() - start

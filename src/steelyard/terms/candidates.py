"""One term many times over, each time with other values of its fields.

The columns of all candidates are computed along the motion, as channels: programs over them do not
know the values, so the next set of candidates needs no new machine code.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.term import Columns, Dissipation, Samples, StatefulTerm, Term, channels_of


@dataclass(frozen=True)
class CandidateTerms(StatefulTerm):
    """Candidates for one term side by side; the parameters of number `c` are named `name@c`.

    Attributes:
        candidates: The term, with one set of values each.
        longest: The term with the longest memory of all that will be compared, so that the same
            samples count for all.
        names: Names of one candidate's parameters.
        places: Rows and parameters of the entries that one candidate's columns have.
    """

    law: ClassVar[str] = "dictionary"
    dissipation: ClassVar[Dissipation] = "none"
    state_only_fields: ClassVar[tuple[str, ...]] = ("candidates", "longest")
    candidates: tuple[Term, ...]
    longest: Term
    names: tuple[str, ...]
    places: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, robot: Robot, candidates: Sequence[Term], longest: Term) -> "CandidateTerms":
        """A dictionary of at least one candidate."""
        first, still = candidates[0], [np.zeros(1)] * robot.n_joints
        channels = [np.zeros(1)] * channels_of(first, robot)
        columns = first.columns(robot, JointState(still, still, still, channels))
        names = tuple(p.name for p in first.parameters(robot))
        return cls(tuple(candidates), longest, names, tuple(columns))

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Those of all candidates."""
        one = self.longest.parameters(robot)
        return tuple(
            replace(p, name=f"{p.name}@{c}") for c in range(len(self.candidates)) for p in one
        )

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The channels."""
        size, width = len(self.places), len(self.names)
        return {
            (row, c * width + column): state.channels[c * size + k]
            for c in range(len(self.candidates))
            for k, (row, column) in enumerate(self.places)
        }

    def n_channels(self, robot: Robot) -> int:
        """One per candidate and entry."""
        return len(self.candidates) * len(self.places)

    def warm_up(self, robot: Robot) -> Array:
        """That of the longest memory."""
        if isinstance(self.longest, StatefulTerm):
            return self.longest.warm_up(robot)
        return np.zeros(robot.n_joints)

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """All candidates' columns along the motion."""
        count = samples.q.shape[1]
        memories = list(memory or [None] * len(self.candidates))
        result = np.empty((self.n_channels(robot), count))
        samples = replace(samples, rigid_torque=_once(samples.rigid_torque))
        row = 0
        for c, term in enumerate(self.candidates):
            channels = np.empty((0, count))
            if isinstance(term, StatefulTerm):
                channels, memories[c] = term.remember(robot, samples, memories[c])
            seen = (list(x) for x in (samples.q, samples.dq, samples.ddq, channels))
            columns = term.columns(robot, JointState(*seen))
            for place in self.places:
                result[row] = columns[place]
                row += 1
        return result, memories


def _once(torque: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """The same function, called once for the same ten numbers."""
    known: dict[bytes, Array] = {}

    def remembered(tens: Array) -> Array:
        key = tens.tobytes()
        if key not in known:
            known[key] = torque(tens)
        return known[key]

    return remembered

"""Candidates for one term side by side, such as fields that are compared.

The columns of all candidates are computed along the motion, as channels: programs over them do not
know the values, so the next set of candidates needs no new machine code.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array, Parameter
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.terms.term import (
    Columns,
    Dissipation,
    StatefulTerm,
    Term,
    TermSamples,
    columns_at_rest,
)
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class CandidateTerms(StatefulTerm):
    """Candidates for one term side by side; the parameters of number `c` are named `name@c`.

    `longest` is the term with the longest memory of all that will be compared, so that the same
    samples count for all; `names` are those of one candidate's parameters, `places` the rows and
    parameters of its columns.
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
        names = tuple(p.name for p in candidates[0].parameters(robot))
        return cls(tuple(candidates), longest, names, tuple(columns_at_rest(candidates[0], robot)))

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
        longest = self.longest
        if isinstance(longest, StatefulTerm):
            return longest.warm_up(robot)
        return super().warm_up(robot)

    def remember(self, robot: Robot, samples: TermSamples, memory: Any) -> tuple[Array, Any]:
        """All candidates' columns along the motion."""
        count = samples.q.shape[1]
        memories = list(memory or [None] * len(self.candidates))
        result = np.empty((self.n_channels(robot), count))
        known: dict[bytes, Array] = {}

        def once(tens: Array, torque: Callable[[Array], Array] = samples.rigid_torque) -> Array:
            key = tens.tobytes()
            if key not in known:
                known[key] = torque(tens)
            return known[key]

        samples = replace(samples, rigid_torque=once)
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

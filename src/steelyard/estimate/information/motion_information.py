r"""The information of a motion's samples about base parameters, and its slope by the motion.

The information about the base parameters is $G = \sum_t \sum_r w_r\, y_{tr} y_{tr}^T$ with the
regressor's rows $y$. For any function $f(G)$ with slope $S = \partial f / \partial G$ the seed of
row $y_{tr}$ is $2 w_r S y_{tr}$, and one sweep backwards through the traced regressor turns the
seeds of all its entries into derivatives by position, velocity and acceleration.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.information.base_regressor import BaseMap, clear_map
from steelyard.model.equations.inverse_dynamics import JointState, completed
from steelyard.model.model import Model
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, softened

_Q, _DQ, _DDQ, _CHANNELS, _WIDTHS = range(5)


@dataclass(frozen=True, eq=False)
class SampledInformation:
    """Regressor entries at samples; what `InformationEvaluator.pull` needs of them."""

    inputs: list[Array]  # what they were computed from, arrays of `(entries, N)`; the widths `(n,)`
    entries: Array  # `(entries, N)`, row by row of the efforts
    step: float  # what a sample counts for
    gram: Array  # $G$, `(c, c)`


@dataclass(frozen=True, eq=False)
class InformationEvaluator:
    """The information that samples of a motion hold about a model's base parameters.

    Laws that jump at zero speed turn within a width of speed, so that the information has slopes;
    with widths of 1e-9 it is that of the jump itself.
    """

    model: Model  # the model; its terms have no memory
    # of the efforts' squares over a second, such as independent samples a second over the variance
    # of their noise, `(n,)`
    weights: Array
    widths: Array  # speeds within which jumps turn, `(n,)` [rad/s; m/s]
    # base parameters that the model does without: they are zero, not unknown
    absent: tuple[str, ...] = ()

    @cached_property
    def base(self) -> BaseMap:
        """The model's base parameters that motions can show, one per column."""
        return clear_map(self.model).without(self.absent)

    def at(self, q: Array, dq: Array, ddq: Array, *, step: float = 1.0) -> SampledInformation:
        """Information of samples `(n, N)`, each `step` times; none where a loop cannot close."""
        scan = self.model.scan(drop=True)
        channels = scan(q, dq, ddq)
        if not scan.closed.all():
            nothing = np.zeros((len(self.base), len(self.base)))
            return SampledInformation([], np.empty((0, q.shape[1])), step, nothing)
        inputs = [q, dq, ddq, channels, self.widths]
        entries = self._entries(inputs)
        gram = np.zeros((len(self.base), len(self.base)))
        for block, (rows, square, weight) in zip(self._blocks(entries), self._places, strict=True):
            if len(rows):
                gram[square] += (step * weight * block) @ block.T
        return SampledInformation(inputs, entries, step, gram)

    def pull(self, seen: SampledInformation, slope: Array) -> tuple[Array, Array, Array]:
        """Derivatives by `q`, `dq`, `ddq`, `(n, N)`, of a function with slope $S$ `(c, c)`."""
        seeds = np.empty_like(seen.entries)
        blocks = zip(self._blocks(seeds), self._blocks(seen.entries), self._places, strict=True)
        for seed, block, (_, square, weight) in blocks:
            seed[:] = (2.0 * seen.step * weight * slope[square]) @ block
        n = self.model.robot.n
        slopes = self._slopes([*seen.inputs, seeds])
        by_q, by_dq, by_ddq, by_channels = np.split(slopes, [n, 2 * n, 3 * n])
        if self._passive_map is not None:
            ways = self._passive_map([seen.inputs[_Q], seen.inputs[_CHANNELS]])
            ways = ways.reshape(len(by_channels), n, -1)
            by_q = by_q + np.einsum("pkt,pt->kt", ways, by_channels)
        return by_q, by_dq, by_ddq

    @cached_property
    def _entries(self) -> Code:
        def build() -> tuple[Program, dict[str, Any]]:
            program, sees = self._program()
            return program, {"sees": sees}

        return compiled(["shown", *self._key], build)

    @cached_property
    def _slopes(self) -> Code:
        def build() -> tuple[Program, dict[str, Any]]:
            from steelyard.symbolic.symbols_and_tracing import pulled_back

            return pulled_back(self._program()[0], (_Q, _DQ, _DDQ, _CHANNELS)), {}

        return compiled(["shown backwards", *self._key], build)

    @cached_property
    def _passive_map(self) -> Code | None:
        """How passive positions follow the independent ones; `None` for a tree."""
        robot = self.model.robot
        if not robot.passive:
            return None

        def build() -> tuple[Program, dict[str, Any]]:
            from steelyard.symbolic.symbols_and_tracing import symbolic

            def rows(q: Any, channels: Any) -> list[Any]:
                still = [0.0] * robot.n
                ways = completed(robot, JointState(q, still, still, channels))[1]
                return [0.0 if x is None else x for row in ways for x in row]

            return symbolic(rows, [Input("q", robot.n), Input("channels", len(robot.passive))]), {}

        return compiled(["passive map", *self._key], build)

    @property
    def _key(self) -> list[Any]:
        return [self.model.program_key, list(self.base.independent)]

    @property
    def sees(self) -> list[list[int]]:
        """Per effort the columns that its row of the regressor holds; all others are zero."""
        return [list(columns) for columns in self._entries.about["sees"]]

    @cached_property
    def _places(self) -> list[tuple[list[int], Any, float]]:
        """Per effort row the columns it sees, where these stand in the information, its weight."""
        return [(s, np.ix_(s, s), w) for s, w in zip(self.sees, self.weights, strict=True)]

    def _blocks(self, entries: Array) -> list[Array]:
        """Views of each effort row's entries, `(seen columns, N)`."""
        ends = np.cumsum([len(seen) for seen, _, _ in self._places])
        return np.split(entries, ends[:-1])

    def _program(self) -> tuple[Program, list[list[int]]]:
        """The regressor's entries with softened jumps, and the columns that each row sees."""
        from steelyard.symbolic.symbols_and_tracing import symbolic

        n, columns = self.model.robot.n, self.base.independent
        place = {column: k for k, column in enumerate(columns)}
        sees: list[list[int]] = []

        def rows(q: Any, dq: Any, ddq: Any, channels: Any, _: Any) -> list[Any]:
            entries = self.model.columns(JointState(q, dq, ddq, channels))
            outputs: list[Any] = []
            for row in range(n):
                seen = sorted(place[c] for r, c in entries if r == row and c in place)
                sees.append(seen)
                outputs += [entries[row, columns[k]] for k in seen]
            return outputs

        inputs = [*self.model.inputs, Input("widths", n, shared=True)]
        return softened(symbolic(rows, inputs), _DQ, _WIDTHS), sees

r"""The regressor of a model as machine code, its low-pass, and the slope of what a motion shows.

Filtering both sides of `effort = columns · parameters` alike leaves the parameters what they are
and removes the noise above the motion's band.

The information about the base parameters is $G = \sum_t \sum_r w_r\, y_{tr} y_{tr}^T$ with the
regressor's rows $y$. For any function $f(G)$ with slope $S = \partial f / \partial G$ the seed of
row $y_{tr}$ is $2 w_r S y_{tr}$, and one sweep backwards through the traced regressor turns the
seeds of all its entries into derivatives by position, velocity and acceleration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.information.base_parameters import BaseMap, base_parameters, clear_map
from steelyard.model.equations.closed_chains import completed
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.model import Model
from steelyard.runs.smoothing.zero_phase_filters import kaiser_lowpass
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, Step, softened


@dataclass(frozen=True)
class Layout:
    """Which columns each effort row sees; the measured effort is the last of each row."""

    columns: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[str, ...]
    # per row the indices of the columns that can be nonzero in it, ascending
    sees: tuple[tuple[int, ...], ...]

    @property
    def widths(self) -> tuple[int, ...]:
        """Columns seen by each row, the effort included."""
        return tuple(len(seen) + 1 for seen in self.sees)

    @property
    def packed_sizes(self) -> tuple[int, ...]:
        """Entries of the lower triangle of each row's Gram matrix."""
        return tuple(width * (width + 1) // 2 for width in self.widths)

    @property
    def starts(self) -> tuple[int, ...]:
        """Where each row's columns begin when all rows' columns stand one after another."""
        return tuple(int(x) for x in np.cumsum((0, *self.widths))[:-1])


@dataclass(frozen=True, eq=False)
class Regressor:
    """Columns of a model over samples."""

    model: Model
    base: BaseMap
    layout: Layout  # names, and what each row sees
    code: Code  # inputs `q`, `dq`, `ddq`, `channels`, `effort`; outputs as `Layout.starts` says

    def dense(self, q: Array, dq: Array, ddq: Array) -> Array:
        """All entries along a motion of `(n, N)` states: shape `(n, N, columns)`."""
        channels = self.model.scan()(q, dq, ddq)
        values = self.code([q, dq, ddq, channels, np.zeros_like(q)])
        result = np.zeros((len(self.layout.rows), q.shape[1], len(self.layout.columns)))
        for row, (start, seen) in enumerate(zip(self.layout.starts, self.layout.sees, strict=True)):
            result[row][:, list(seen)] = values[start : start + len(seen)].T
        return result


def base_regressor(model: Model) -> Regressor:
    """The regressor of the structural base parameters."""
    base = base_parameters(model)
    return chosen_regressor(model, base, base.independent)


def standard_regressor(model: Model) -> Regressor:
    """The regressor of all standard parameters."""
    return chosen_regressor(model, base_parameters(model), range(len(model.parameters)))


def chosen_regressor(model: Model, base: BaseMap, columns: Sequence[int]) -> Regressor:
    """The regressor of some standard parameters by their indices, whatever structure says.

    The base parameters may be those of other columns, such as of the terms that are not compared.
    """
    place = {column: k for k, column in enumerate(columns)}

    def build() -> tuple[Program, dict[str, Any]]:
        program, places = model.columns_program
        step_of = dict(zip(places, program.outputs, strict=True))
        inputs = (*program.inputs, Input("effort", model.robot.n))
        efforts = [Step("input", (len(program.inputs), row)) for row in range(model.robot.n)]
        sees: list[list[int]] = [[] for _ in range(model.robot.n)]
        for row, column in places:
            if column in place:
                sees[row].append(place[column])
        outputs: list[int] = []
        for row, seen in enumerate(sees):
            seen.sort()
            outputs += [step_of[row, columns[k]] for k in seen] + [len(program.steps) + row]
        chosen = Program(inputs, (*program.steps, *efforts), tuple(outputs))
        return chosen.pruned(), {"sees": sees}

    code = compiled(["regressor", model.program_key, list(columns)], build)
    layout = Layout(
        columns=tuple(model.names[c] for c in columns),
        units=tuple(model.units[c] for c in columns),
        rows=model.robot.joint_names,
        sees=tuple(tuple(seen) for seen in code.about["sees"]),
    )
    return Regressor(model, base, layout, code)


SUPPRESSION = 60.0  # attenuation above twice the cut-off [dB]
FINE = 40.0  # sampling rate over cut-off at which the noise bandwidth is taken


@dataclass(frozen=True, eq=False)
class ParallelFilter:
    """A symmetric FIR low-pass that keeps every `decimation`-th sample."""

    cutoff: float  # half-amplitude frequency [Hz]
    rate: float  # sampling rate it was made for [Hz]
    taps: Array  # odd number of coefficients, sum 1
    # samples per kept sample; kept samples come at four times the cut-off or faster
    decimation: int

    @classmethod
    def design(cls, cutoff: float, rate: float) -> "ParallelFilter":
        """Kaiser-windowed low-pass, `SUPPRESSION` dB down from twice the cut-off on.

        The cut-off [Hz] is below a quarter of the rate [Hz].
        """
        taps = kaiser_lowpass(SUPPRESSION, 2.0 * cutoff / rate, 2.0 * cutoff / rate)
        return cls(cutoff, rate, frozen(taps), max(1, int(rate / (4.0 * cutoff))))

    @property
    def inflation(self) -> float:
        r"""Variance of an estimate per variance if the filtered residuals were uncorrelated.

        White noise through the filter has autocorrelation $r$; a slowly varying column meets its
        sum over the kept samples, $\sum_k r(kD) / r(0)$.
        """
        full = np.correlate(self.taps, self.taps, mode="full")
        centre = len(self.taps) - 1
        kept = full[centre % self.decimation :: self.decimation]
        return float(kept.sum() / full[centre])


def noise_bandwidth(cutoff: float) -> float:
    """Bandwidth of an ideal low-pass that leaves as much of white noise as the filter [Hz]."""
    filter_ = ParallelFilter.design(cutoff, FINE * cutoff)
    return float(0.5 * FINE * cutoff * np.sum(np.square(filter_.taps)))


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

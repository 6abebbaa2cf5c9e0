"""The regressor of a model as machine code, and the low-pass filter of its columns and the effort.

Filtering both sides of `effort = columns · parameters` alike leaves the parameters what they are
and removes the noise above the motion's band.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.information.base_parameters import BaseMap, base_parameters
from steelyard.model.model import Model
from steelyard.runs.smoothing.filters import kaiser_lowpass
from steelyard.symbolic.native.compiled import Code, compiled
from steelyard.symbolic.program import InputArray as Input
from steelyard.symbolic.program import Program, Step


@dataclass(frozen=True)
class Layout:
    """Which columns each effort row sees; the measured effort is the last of each row.

    Attributes:
        sees: Per row the indices of the columns that can be nonzero in it, ascending.
    """

    columns: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[str, ...]
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
    """Columns of a model over samples.

    Attributes:
        layout: Names, and what each row sees.
        code: Inputs `q`, `dq`, `ddq`, `channels`, `effort`; outputs as `Layout.starts` says.
    """

    model: Model
    base: BaseMap
    layout: Layout
    code: Code

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


SUPPRESSION = 60.0
"""Attenuation above twice the cut-off [dB]."""

FINE = 40.0
"""Sampling rate over cut-off at which the noise bandwidth is taken."""


@dataclass(frozen=True, eq=False)
class ParallelFilter:
    """A symmetric FIR low-pass that keeps every `decimation`-th sample.

    Attributes:
        cutoff: Half-amplitude frequency [Hz].
        rate: Sampling rate it was made for [Hz].
        taps: Odd number of coefficients, sum 1.
        decimation: Samples per kept sample; kept samples come at four times the cut-off or faster.
    """

    cutoff: float
    rate: float
    taps: Array
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

    @property
    def description(self) -> str:
        """For fingerprints and reports."""
        return f"FIR low-pass {self.cutoff:g} Hz, {len(self.taps)} taps at {self.rate:g} Hz"


def noise_bandwidth(cutoff: float) -> float:
    """Bandwidth of an ideal low-pass that leaves as much of white noise as the filter [Hz]."""
    filter_ = ParallelFilter.design(cutoff, FINE * cutoff)
    return float(0.5 * FINE * cutoff * np.sum(np.square(filter_.taps)))

"""The regressor of a model as machine code."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters import BaseMap, base_parameters
from steelyard.model.model import Model
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, Step


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

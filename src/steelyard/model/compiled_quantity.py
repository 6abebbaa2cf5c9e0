"""Quantities of a model as machine code, along whole motions."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.motion import check_finite, shaped
from steelyard.model.terms.channels_along_motion import Scan
from steelyard.model.torque_and_quantities import Equations, Quantity
from steelyard.symbolic.native.compiled_programs import Code
from steelyard.symbolic.native.llvm_vector_code import MAX_ANGLE

BLOCK = 2040
"""Samples computed at once: an odd number of cache lines, or all rows would share a few places of
the cache."""


@dataclass(frozen=True, eq=False)
class CompiledQuantity:
    """A quantity of a model: the equations of the terms that enter it, and machine code.

    `columns` are the places of their parameters; inputs of the code are the arguments, channels and
    parameters.
    """

    quantity: Quantity
    part: Equations
    columns: Sequence[int]
    code: Code

    @cached_property
    def step_code(self) -> Code:
        """Machine code of one step, see `Quantity.program`."""
        return self.quantity.code(self.part, stepped=True)

    def along(self, values: Array, arguments: Sequence[ArrayLike], t: Array | None = None) -> Array:
        """Entries at one configuration or along samples; see `Dynamics.evaluate`."""
        n, names = self.part.robot.n, self.quantity.arguments
        first = shaped(names[0], arguments[0], [(n,), (None, n)])
        rest = zip(names[1:], arguments[1:], strict=True)
        given = [first, *(shaped(name, x, [first.shape]) for name, x in rest)]
        rows = [np.atleast_2d(x) for x in given]
        result = np.empty((len(rows[0]), self.code.n_outputs))
        scan, parameters = self.part.scan(), values[self.columns]
        for start in range(0, len(result), BLOCK):
            part = slice(start, start + BLOCK)
            self.check_arguments([x[part] for x in rows])
            block = [x[part].T for x in rows]
            channels = self.channels(scan, block, None if t is None else t[part])
            entries = self.code([*block, channels, parameters])
            self.check(rows[0][part], entries.T)
            result[part] = entries.T
        return result.reshape(*first.shape[:-1], *self.quantity.shape(self.part))

    def check_arguments(self, arguments: Sequence[Array]) -> None:
        """No argument is infinite, and no position beyond 1e5 rad, else it is a `DataError`."""
        for name, x in zip(self.quantity.arguments, arguments, strict=True):
            check_finite(name, x)
        check_angles(arguments[0])

    def channels(self, scan: Scan, block: Sequence[Array], t: Array | None = None) -> Array:
        """Channels of samples `(n, N)`, after those in `scan`; what is not given is zero."""
        given = dict(zip(self.quantity.arguments, block, strict=True))
        rest = np.zeros_like(block[0])
        return scan(block[0], given.get("dq", rest), given.get("ddq", rest), t)

    def check(self, q: Array, entries: Array) -> None:
        """Refuse NaN, or a mass matrix that none has; `q` `(N, n)`, `(N, entries)`."""
        if self.quantity.pivot and not (possible := entries[:, -1] > 0.0).all():
            posture = ", ".join(f"{x:.4g}" for x in q[int(np.argmin(possible))])
            raise DataError(
                f"the mass matrix is not positive definite at q = [{posture}]",
                where=f"model of '{self.part.robot.name}'",
                fix='identify with method = "consistent", which allows only bodies that can '
                "exist, or add rotor_inertia to the terms",
            )
        if np.isfinite(entries).all():
            return
        raise DataError(
            f"a value of the {self.quantity.name} is not finite",
            where="velocities `dq`, accelerations `ddq` and efforts `tau`",
            fix="check their units, and leave out samples without a number",
        )


def check_angles(q: Array) -> None:
    """Machine code reduces angles exactly only up to a limit, beyond which it is a `DataError`."""
    if q.size and not np.abs(q).max() <= MAX_ANGLE:
        raise DataError(
            f"a joint position lies beyond {MAX_ANGLE:g} rad or is not finite",
            where="positions `q`",
            fix="check the unit of the position columns (rad, not encoder counts)",
        )

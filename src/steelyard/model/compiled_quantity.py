"""Quantities of a model as machine code: along whole motions, or one sample after the other."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.motion import check_finite, shaped
from steelyard.model.dynamics import Dynamics
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.terms.stateful_terms import Scan
from steelyard.model.torque_and_quantities import TORQUE, Equations, Quantity
from steelyard.robot.robot import Robot
from steelyard.symbolic.native.compiled_programs import Code, SampleCall
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


_SAFE_SQUARED_ANGLE = MAX_ANGLE**2
"""Sum of squares below which no position is too large for the machine code."""


class Stepper(Dynamics):
    """Sample-by-sample evaluation of a model with values; results have no axis of samples.

    Buffers are made once, and checks are few: a step of seven joints with friction takes some
    microseconds. Friction with memory and closed chains remember the steps before, of each quantity
    on its own; a new motion needs a new stepper, and so does every thread. Passive joints of closed
    chains must move by less than about 0.5 rad from step to step, or they can take another of the
    positions that close the chain.

    Example:
        >>> model = load_model("arm-model")
        >>> stepper = model.start()
        >>> q, dq, ddq = [0.3, 0.5], [1.0, -0.5], [2.0, 0.0]
        >>> bool(abs(stepper.step(q, dq, ddq) - model.torque(q, dq, ddq)).max() < 1e-9)
        True
        >>> stepper.mass_matrix(q).shape
        (2, 2)
    """

    def __init__(
        self, robot: Robot, compiled: Callable[[Quantity], CompiledQuantity], values: Array
    ) -> None:
        """Begin with machine code of quantities and all parameters of the model."""
        self._robot, self._compiled, self._values = robot, compiled, values
        self._samples: dict[Quantity, _Sample] = {}

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self._robot

    def evaluate(self, quantity: Quantity, *arguments: ArrayLike, t: Array | None = None) -> Array:
        """A quantity at one sample, each argument of shape `(n,)`; see `Dynamics.evaluate`."""
        found = self._samples.get(quantity)
        if found is None:
            found = _Sample(self._compiled(quantity), self._values)
            self._samples[quantity] = found
        return found(arguments, t)

    def start(self) -> "Stepper":
        """Begin anew: a stepper that remembers no steps."""
        return Stepper(self._robot, self._compiled, self._values)

    def step(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Joint efforts of all terms at the next sample, shape `(n,)`, as `torque`.

        Raises:
            DataError: An argument has another shape, or a position lies beyond 1e5 rad.
        """
        return self.evaluate(TORQUE, q, dq, ddq)


class _Sample:
    """One quantity with its buffers: entries of arguments lie side by side.

    The machine code reads vectors of several samples, so that only the first lane is of this one.
    """

    def __init__(self, compiled: CompiledQuantity, values: Array) -> None:
        part, quantity = compiled.part, compiled.quantity
        stepped = part.n_memory > 0 and part.steps
        code = compiled.step_code if stepped else compiled.code
        n, count, spare = part.robot.n, len(quantity.arguments), code.lanes - 1
        self._compiled, self._joints, self._pivot = compiled, (n,), quantity.pivot
        self._given = np.zeros(count * n + spare)
        self._rows = [self._given[k * n : (k + 1) * n] for k in range(count)]
        scanned = Equations(part.robot, ()) if stepped else part
        self._scan = scanned.scan() if scanned.n_channels else None
        self._channels = np.zeros(scanned.n_channels + spare)
        self._memory = np.zeros(part.n_memory + spare)
        self._stepped, self._begun = stepped, False
        parameters = np.ascontiguousarray(values[compiled.columns])
        inputs = [*self._rows, self._channels, *([self._memory] if stepped else []), parameters]
        call = SampleCall(code, inputs, self._given[: count * n], _SAFE_SQUARED_ANGLE)
        self._sample, self._call, self._outputs = call, call.call, call.result
        shape = quantity.shape(part)
        self._result = self._outputs[: math.prod(shape)].reshape(shape)

    def __call__(self, arguments: Sequence[ArrayLike], t: Array | None) -> Array:
        for row, values in zip(self._rows, arguments, strict=True):
            x = np.asarray(values)
            if x.shape != self._joints or x.dtype.kind not in "iuf":
                raise DataError(
                    f"values of shape {x.shape}, type {x.dtype}, for {self._joints[0]} joints",
                    where=", ".join(self._compiled.quantity.arguments),
                    fix="give one number per joint in each",
                )
            row[...] = x
        if self._scan is not None:
            self._look(self._scan, t)
        if self._stepped and not self._begun:
            self._begin()
        if not self._call() or self._pivot and not self._result[-1] > 0.0:
            self._compiled.check_arguments(self._rows)
            self._compiled.check(self._rows[0][None], self._result.reshape(1, -1))
        if self._stepped:
            after = self._outputs[self._result.size :]
            self._memory[: len(after)] = after
        return self._result.copy()

    def _look(self, scan: Scan, t: Array | None) -> None:
        if not self._given.dot(self._given) < _SAFE_SQUARED_ANGLE:
            self._compiled.check_arguments(self._rows)
        channels = self._compiled.channels(scan, [row[:, None] for row in self._rows], t)[:, 0]
        self._channels[: len(channels)] = channels

    def _begin(self) -> None:
        self._compiled.check_arguments(self._rows)
        part, given = self._compiled.part, self._compiled.quantity.arguments
        q, dq = (dict(zip(given, self._rows, strict=True))[name].tolist() for name in ("q", "dq"))
        passive = self._channels[: len(part.robot.passive)].tolist()
        self._memory[: part.n_memory] = part.started(JointState(q, dq, [0.0] * len(q), passive))
        self._begun = True

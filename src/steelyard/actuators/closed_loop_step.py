r"""One step of an arm under position controllers, as machine code, and its directional derivative.

The step of length $h$ is Euler's, linearly implicit in the controller's spring and damper and
explicit in the bodies' rates: with the mass matrix $M$, the bias $b(q, \dot q)$ of gravity and
rates, rotor inertias $a$ and the controller's torque $\tau$ from the target, without its damper,

$$ A\,v^+_0 = (M + a)\,v + h\,(\tau - b), \qquad
   A = M + \operatorname{diag}(a + h k_d + h^2 k_p), $$

where a controller at its torque limit has neither spring nor damper in $A$. Dry friction is an
impulse $\lambda_j$ within $\pm h f_j$ that stops joint $j$ if it can,
$v^+ = v^+_0 - A^{-1} \lambda$, by a few sweeps of projected Gauss-Seidel over the joints
[Stewart1996], so that a joint sticks exactly, at any step. Every operation has a derivative but at
its corners: the derivative that goes along is that of the steps themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.actuators.actuator_parameters import IN_STEP
from steelyard.base.arrays import Array
from steelyard.model.equations.inverse_dynamics import JointState, solved_by_factors
from steelyard.model.model import Model
from steelyard.symbolic.native.compiled_programs import Code, compiled_equations
from steelyard.symbolic.program_and_softening import InputArray

SWEEPS = 3  # over all joints, for friction
STATE = ("q", "v", "target")
VARIED = (*STATE, *IN_STEP)  # inputs that a direction has a component along


@dataclass(frozen=True, eq=False)
class ArmStep:
    """The step of one arm: `model` with bodies alone, at `values` of its parameters."""

    model: Model
    values: Array

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.robot.n

    @cached_property
    def code(self) -> Code:
        """From `VARIED`, `(n, N)` each, and the shared `h` to the next positions and velocities."""
        inputs = [*(InputArray(name, self.n) for name in VARIED), InputArray("h", 1, shared=True)]
        return compiled_equations([*self._key, "step"], self._next, inputs)

    @cached_property
    def tangent(self) -> Code:
        """The same with a direction behind `VARIED`; its outputs are followed by their rates."""
        from steelyard.symbolic.symbols_and_tracing import carried_along

        count = len(VARIED)
        inputs = [InputArray(name, self.n) for name in VARIED]
        inputs += [InputArray(f"d{name}", self.n) for name in VARIED]
        inputs += [InputArray("h", 1, shared=True)]

        def both(*x: Any) -> list[Any]:
            found = self._next(*x[:count], x[-1])
            at, along = ([y for part in some for y in part] for some in (x[:count], x[count:-1]))
            return [*found, *carried_along(found, at, along)]

        return compiled_equations([*self._key, "tangent"], both, inputs)

    @property
    def _key(self) -> list[Any]:
        return [
            "arm under position controllers",
            self.model.program_key,
            self.values.tolist(),
            SWEEPS,
        ]

    def _next(self, q: Any, v: Any, u: Any, *rest: Any) -> list[Any]:
        """The equations of this file, over symbols."""
        from steelyard.symbolic.symbols_and_tracing import affine

        *given, (h,) = rest
        kp, kd, coulomb, load, armature, limit, band = given
        values, joints = [float(x) for x in self.values], range(self.n)
        mass, bias = affine(lambda ddq: self.model.torque_of(JointState(q, v, ddq), values), self.n)
        matrix, impulse, bound = [list(row) for row in mass], [], []
        for j in joints:
            error = u[j] - q[j]
            spring = kp[j] * (error - np.minimum(np.maximum(error, -band[j]), band[j]))
            wanted = spring - kd[j] * v[j]
            acts = np.less_equal(abs(wanted), limit[j])
            engaged = acts * np.less_equal(band[j], abs(error))
            clipped = np.minimum(np.maximum(wanted, -limit[j]), limit[j])
            matrix[j][j] = mass[j][j] + armature[j] + h * (acts * kd[j] + h * engaged * kp[j])
            momentum = armature[j] * v[j]
            for k in joints:
                momentum = momentum + mass[j][k] * v[k]
            torque = acts * spring + (1.0 - acts) * clipped
            impulse.append(momentum + h * (torque - bias[j]))
            bound.append(h * (coulomb[j] + load[j] * abs(clipped)))
        columns = [[1.0 if j == k else 0.0 for j in joints] for k in joints]
        (free, *inverse), _ = solved_by_factors(matrix, [impulse, *columns])
        return _stopped(q, free, inverse, bound, h)


def _stopped(
    q: Sequence[Any],
    free: Sequence[Any],
    inverse: Sequence[Sequence[Any]],
    bound: Sequence[Any],
    h: Any,
) -> list[Any]:
    """Positions and velocities behind the impulses of dry friction."""
    joints = range(len(free))
    v, held = list(free), [0.0 * b for b in bound]
    for _ in range(SWEEPS):
        for j in joints:
            wanted = held[j] + v[j] / inverse[j][j]
            within = np.minimum(np.maximum(wanted, -bound[j]), bound[j])
            change, held[j] = within - held[j], within
            for k in joints:
                v[k] = v[k] - inverse[j][k] * change
    return [*(q[j] + h * v[j] for j in joints), *v]

r"""One step of an arm under position controllers, as machine code, and its directional derivative.

The step of length $h$ is that of the backward differentiation formula of second order [Gear1971]:
it damps what is faster than $h$, such as the controller's damper against a small rotor, and its
error is of second order, so that stiffness and damping do not depend on $h$. Implicit are the
controller's spring and damper; mass matrix $M$ and bias $b$ of gravity and rates are taken at the
predicted state $\hat q = q + h v$, $\hat v = 2 v - v_-$. With $k = 2 h / 3$, rotor inertias $a$ and
the target $u$ at the end of the step,

$$ A\,v^+_0 = (M + a)\,\tfrac{1}{3} (4 v - v_-) + k\,(k_p (u - \tilde q) - b), \qquad
   \tilde q = \tfrac{1}{3} (4 q - q_-), $$

$$ A = M + \operatorname{diag}(a + k\, (k_d + k_e) + k^2 k_p), \qquad q^+ = \tilde q + k\, v^+, $$

where a controller at its torque limit has neither spring nor damper $k_d$ in $A$. The torque of
its integral gain adds to the spring's, grows by the error in the middle of the step, and is held at
the torque limit. Dry friction is
an impulse $\lambda_j$ within $\pm k f_j$, with $f_j$ at the predicted state, that stops joint $j$
if it can, $v^+ = v^+_0 - A^{-1} \lambda$, by a few sweeps of projected Gauss-Seidel over the joints
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

DIRECTIONS = 3  # that one lane of the derivative carries along: the step itself is then shared
SWEEPS = 3  # over all joints, for friction
STATE = ("q", "v", "integral_torque", "q_before", "v_before")
CARRIED = 3  # of these, that a step gives anew
VARIED = (*STATE, "target", *IN_STEP)  # inputs that a direction has a component along


@dataclass(frozen=True, eq=False)
class ArmStep:
    """The step of one arm: `model` with bodies alone, at `values` of its parameters."""

    model: Model
    values: Array

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.robot.n

    @property
    def kinds(self) -> tuple[str, ...]:
        """`revolute` or `prismatic`, by joint."""
        return tuple(joint.kind for joint in self.model.robot.coordinates)

    @cached_property
    def code(self) -> Code:
        """From `VARIED`, `(n, N)` each, and the shared `h` to what the next step begins with."""
        inputs = [*(InputArray(name, self.n) for name in VARIED), InputArray("h", 1, shared=True)]
        return compiled_equations([*self._key, "step"], self._next, inputs)

    @cached_property
    def tangent(self) -> Code:
        """The same with directions behind `VARIED`; rates of the outputs follow, one by one."""
        from steelyard.symbolic.symbols_and_tracing import carried_along

        count = len(VARIED)
        inputs = [InputArray(name, self.n) for name in VARIED]
        inputs += [InputArray(f"{name} {k}", self.n) for k in range(DIRECTIONS) for name in VARIED]
        inputs += [InputArray("h", 1, shared=True)]

        def both(*x: Any) -> list[Any]:
            found = self._next(*x[:count], x[-1])
            at = [y for part in x[:count] for y in part]
            result = list(found)
            for k in range(1, DIRECTIONS + 1):
                along = [y for part in x[k * count : (k + 1) * count] for y in part]
                result += carried_along(found, at, along)
            return result

        return compiled_equations([*self._key, "tangent", DIRECTIONS], both, inputs)

    @property
    def _key(self) -> list[Any]:
        described = [self.model.program_key, self.values.tolist()]
        return ["arm under position controllers", list(VARIED), *described, SWEEPS]

    def _next(self, q: Any, v: Any, w: Any, q0: Any, v0: Any, u: Any, *rest: Any) -> list[Any]:
        """The equations of this file, over symbols."""
        from steelyard.symbolic.symbols_and_tracing import affine

        *given, (h,) = rest
        kp, ki, kd, emf, coulomb, stribeck, stribeck_speed, load, *other = given
        armature, limit, band, factor = other
        joints, k = range(self.n), 2.0 / 3.0 * h
        moves = [body.coordinate for body in self.model.robot.bodies]
        values = [float(x) * factor[moves[i // 10]] for i, x in enumerate(self.values)]
        soon = [q[j] + h * v[j] for j in joints]
        fast = [2.0 * v[j] - v0[j] for j in joints]
        mass, bias = affine(
            lambda ddq: self.model.torque_of(JointState(soon, fast, ddq), values), self.n
        )
        known = [(4.0 * q[j] - q0[j]) / 3.0 for j in joints]
        speed = [(4.0 * v[j] - v0[j]) / 3.0 for j in joints]
        matrix, impulse, bound, grown = [list(row) for row in mass], [], [], []
        for j in joints:
            behind = kp[j] * np.minimum(np.maximum(u[j] - soon[j], -band[j]), band[j])
            wanted = kp[j] * (u[j] - soon[j]) - behind - kd[j] * fast[j] + w[j]
            middle = u[j] - 0.5 * (q[j] + soon[j])
            middle = middle - np.minimum(np.maximum(middle, -band[j]), band[j])
            grows = h * ki[j] * middle * np.less_equal(abs(wanted), limit[j])
            wanted, held = wanted + grows, w[j] + grows
            acts = np.less_equal(abs(wanted), limit[j])
            engaged = acts * np.less_equal(band[j], abs(u[j] - soon[j]))
            clipped = np.minimum(np.maximum(wanted, -limit[j]), limit[j])
            spring = engaged * (kp[j] * (u[j] - known[j]) - behind) + acts * held
            damper = acts * kd[j] + emf[j]
            matrix[j][j] = mass[j][j] + armature[j] + k * (damper + k * engaged * kp[j])
            momentum = armature[j] * speed[j]
            for i in joints:
                momentum = momentum + mass[j][i] * speed[i]
            impulse.append(momentum + k * (spring + (1.0 - acts) * clipped - bias[j]))
            slow = np.exp(-((fast[j] / stribeck_speed[j]) ** 2))
            grown.append(held)
            bound.append(k * (coulomb[j] + stribeck[j] * slow + load[j] * abs(clipped)))
        columns = [[1.0 if j == i else 0.0 for j in joints] for i in joints]
        (free, *inverse), _ = solved_by_factors(matrix, [impulse, *columns])
        speeds = _stopped(free, inverse, bound)
        return [*(known[j] + k * speeds[j] for j in joints), *speeds, *grown]


def _stopped(
    free: Sequence[Any], inverse: Sequence[Sequence[Any]], bound: Sequence[Any]
) -> list[Any]:
    """Velocities behind the impulses of dry friction."""
    joints = range(len(free))
    v, held = list(free), [0.0 * b for b in bound]
    for _ in range(SWEEPS):
        for j in joints:
            wanted = held[j] + v[j] / inverse[j][j]
            within = np.minimum(np.maximum(wanted, -bound[j]), bound[j])
            change, held[j] = within - held[j], within
            for i in joints:
                v[i] = v[i] - inverse[j][i] * change
    return v

r"""Joint controllers, and how a model moves under torques, many sets of parameters at once.

$\ddot q = M(q)^{-1} (\tau - h(q, \dot q))$ with mass matrix and bias of the traced inverse
dynamics, rotor inertia included. Base parameters suffice, with the others of each group at zero:
the torque is the same, so the mass matrix is too. Laws that jump at zero speed, such as Coulomb
friction, turn within a small speed instead (see `softened`): with fixed steps they would
chatter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.model import Model
from steelyard.model.torque_and_quantities import Efforts, accelerations
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray, Program, softened


@dataclass(frozen=True, eq=False)
class JointPD:
    """Feedback by stiffness `(n,)` [Nm/rad; N/m] and damping `(n,)` [Nm s/rad; N s/m] per joint."""

    stiffness: Array
    damping: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", frozen(self.stiffness, (None,)))
        object.__setattr__(self, "damping", frozen(self.damping, self.stiffness.shape))

    def torque(self, error: Array, rate: Array) -> Array:
        """Joint torques from errors of position and velocity, wanted minus true, `(..., n)`."""
        return np.asarray(self.stiffness * error + self.damping * rate)


def tuned_pd(masses: Array, bandwidth: float = 20.0, rate: float = 1000.0) -> JointPD:
    r"""Critically damped gains.

    $k_p = \omega^2 m_j$ and $k_d = 2 \omega m_j$ with $m_j$ the mean of $M_{jj}$ of mass matrices
    at some postures, shape `(K, n, n)`. The bandwidth, the natural frequency of a joint's error
    [Hz], is lowered where joints are coupled so strongly that one tick would not be stable:
    $\lambda_{max}(M^{-1} K_d) / f \le 1/2$ at all postures, $f$ ticks a second.
    """
    own, fastest = joint_inertia(masses, rate)
    omega = min(2.0 * np.pi * bandwidth, fastest)
    return JointPD(omega**2 * own, 2.0 * omega * own)


def joint_inertia(masses: Array, rate: float = 1000.0) -> tuple[Array, float]:
    """Mean inertia of joints `(n,)` of masses `(K, n, n)`; greatest stable frequency [rad/s]."""
    own = np.diagonal(masses, axis1=1, axis2=2).mean(axis=0)
    coupling = float(np.abs(np.linalg.eigvals(np.linalg.solve(masses, np.diag(own)[None]))).max())
    return own, rate / (4.0 * coupling)


VELOCITY, WIDTHS = 1, 4  # numbers of input arrays
LONGEST_STEP = 5e-4  # longest step of the integration [s]
STIFFEST = 4000.0  # friction's fastest braking: 2 over the longest step, of the method's 2.78 [1/s]
LEAST_WIDTH = {"revolute": 0.005, "prismatic": 0.001}  # least turning speed [rad/s; m/s]


@dataclass(frozen=True, eq=False)
class Forward:
    """Forward dynamics of a model in some of its parameters, the others at zero."""

    model: Model  # without loops and friction with memory
    columns: tuple[int, ...]  # indices of the standard parameters in use, `p` of them

    def __post_init__(self) -> None:
        if self.model.robot.passive:
            why, fix = "it has closed loops", "use an estimator that does not"
        elif self.model.n_channels:
            why, fix = (
                "its friction has internal states",
                "use friction laws without internal states, such as coulomb and viscous, or an "
                "estimator that does not simulate",
            )
        else:
            return
        where = f"model of '{self.model.robot.name}'"
        raise DataError(f"the model cannot be simulated here: {why}", where=where, fix=fix)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.robot.n

    def mass_and_bias(
        self, q: Array, dq: Array, values: Array, widths: Array
    ) -> tuple[Array, Array]:
        r"""Mass matrices `(B, n, n)` and efforts at rest `(B, n)`, $\tau = M \ddot q + h$.

        Positions and velocities are of shape `(n, B)`, parameters `(p, B)` or `(p,)`, the speeds
        within which jumps turn `(n,)`.
        """
        lanes = np.broadcast_to(np.reshape(values, (len(values), -1)), (len(values), q.shape[1]))
        result = self._mass([q, dq, np.zeros_like(q), lanes, widths])
        mass = result[: self.n**2].reshape(self.n, self.n, -1)
        return np.moveaxis(mass, 2, 0).copy(), result[self.n**2 :].T.copy()

    def widths(self, q: Array, values: Array) -> Array:
        r"""Speeds within which jumps turn, so wide that steps of `LONGEST_STEP` follow them.

        Near zero speed a law that jumps by $\pm f$ brakes at the rate $(M^{-1})_{jj} f / w$. Looked
        at are postures `(n, B)`, with parameters `(p,)`, at all of which the mass matrix must be
        positive definite.
        """
        least = np.array([LEAST_WIDTH[c.kind] for c in self.model.robot.coordinates])
        speed = np.repeat(least[:, None], q.shape[1], axis=1)
        mass, ahead = self.mass_and_bias(q, 20.0 * speed, values, least)
        back = self.mass_and_bias(q, -20.0 * speed, values, least)[1]
        if not (np.linalg.eigvalsh(mass)[:, 0] > 0.0).all():
            raise impossible_mass(self.model)
        mobility = np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2)
        fastest = (0.5 * np.abs(ahead - back) * mobility).max(axis=0)
        return frozen(np.maximum(least, fastest / STIFFEST))

    @cached_property
    def code(self) -> Code:
        """One step of integration; see `runge_kutta`."""

        def outputs(effort: Efforts, applied: Sequence[Scalar]) -> list[Scalar]:
            found, pivots = accelerations(effort, applied)
            return [*found, *pivots]

        return self._compiled("forward", lambda: runge_kutta(self._traced(outputs), self.n))

    @cached_property
    def _mass(self) -> Code:
        def outputs(effort: Efforts, _: Sequence[Scalar]) -> list[Scalar]:
            from steelyard.symbolic.symbols_and_tracing import affine

            mass, bias = affine(effort, self.n)
            return [entry for row in mass for entry in row] + bias

        return self._compiled("mass and bias", lambda: self._traced(outputs))

    def _compiled(self, kind: str, program: Callable[[], Program]) -> Code:
        key = [kind, self.model.program_key, list(self.columns)]
        return compiled(key, lambda: (program(), {}))

    def _traced(self, outputs: Any) -> Program:
        """A program over state, applied efforts, parameters and widths, its jumps softened.

        Parameters come sample by sample: many sets of them move side by side.
        """
        from steelyard.symbolic.symbols_and_tracing import symbolic

        def build(q: Any, dq: Any, applied: Any, parameters: Any, _: Any) -> list[Scalar]:
            values: list[Scalar] = [0.0] * len(self.model.parameters)
            for column, value in zip(self.columns, parameters, strict=True):
                values[column] = value
            return list(
                outputs(lambda ddq: self.model.torque_of(JointState(q, dq, ddq), values), applied)
            )

        sizes = {"q": self.n, "dq": self.n, "effort": self.n, "parameters": len(self.columns)}
        inputs = [InputArray(name, size) for name, size in sizes.items()]
        inputs.append(InputArray("widths", self.n, shared=True))
        return softened(symbolic(build, inputs), VELOCITY, WIDTHS)


def runge_kutta(program: Program, n: int) -> Program:
    """One step of the classical fourth-order method, efforts held.

    Of a program over state, efforts, parameters and widths, whose outputs are `n` accelerations,
    then pivots. It has the same inputs, and the step [s]; outputs are the new `q` and `dq`, then
    the least pivot of all stages.
    """
    from steelyard.symbolic.symbols_and_tracing import replayed, symbolic

    def build(q: Any, dq: Any, *rest: Any) -> list[Scalar]:
        *held, (step,) = rest
        half = 0.5 * step
        at, speed, pivots = q, dq, list[Scalar]()
        stages: list[tuple[Scalars, Scalars]] = []
        for ahead in (half, half, step, None):
            found = replayed(program, [at, speed, *held])
            stages.append((speed, found[:n]))
            pivots += found[n:]
            if ahead is not None:
                at = [x + ahead * v for x, v in zip(q, speed, strict=True)]
                speed = [x + ahead * a for x, a in zip(dq, found[:n], strict=True)]
        ends = []
        for start, slopes in zip((q, dq), zip(*stages, strict=True), strict=True):
            for x, first, second, third, fourth in zip(start, *slopes, strict=True):
                mean = (first + fourth + 2.0 * (second + third)) * (1.0 / 6.0)
                ends.append(x + step * mean)
        return [*ends, *([reduce(np.minimum, pivots)] if pivots else [])]

    return symbolic(build, (*program.inputs, InputArray("step", 1, shared=True)))


class Integration:
    """Lanes that move side by side; buffers are made once.

    To positions `q` and velocities `dq` may be written, as to the efforts that the next steps hold,
    all `(n, L)`; `least` is the least pivot of the mass matrices of the last step, `(L,)`.
    """

    def __init__(self, dynamics: Forward, values: Array, widths: Array) -> None:
        """Begin at rest at zero, with parameters `(p, L)` and widths of jumps `(n,)`."""
        code, n = dynamics.code, dynamics.n
        count = values.shape[1]
        padded = -(-count // code.lanes) * code.lanes
        self._state, self._next = np.zeros((2 * n + 1, padded)), np.zeros((2 * n + 1, padded))
        self._effort, self._step = np.zeros((n, padded)), np.zeros(1)
        self._values = np.repeat(values[:, :1], padded, axis=1)
        self._widths = np.ascontiguousarray(widths)
        self.q, self.dq = self._state[:n, :count], self._state[n : 2 * n, :count]
        self._values[:, :count] = values
        self.effort, self.least = self._effort[:, :count], self._state[2 * n, :count]
        self._spare = slice(count, padded)
        arrays = (self._state[:n], self._state[n : 2 * n], self._effort, self._values)
        shared = (self._widths, self._step)
        self._call = [
            padded,
            *(x for a in arrays for x in (a.ctypes.data, padded)),
            *(x for a in shared for x in (a.ctypes.data, 0)),
            self._next.ctypes.data,
            padded,
        ]
        self._raw = code.raw

    def advance(self, duration: float) -> None:
        """Hold the efforts for a time [s], in steps of at most `LONGEST_STEP`."""
        count = max(1, int(np.ceil(duration / LONGEST_STEP - 1e-9)))
        self._step[0] = duration / count
        if self._spare.start < self._spare.stop:
            self._state[:, self._spare] = self._state[:, :1]
            self._effort[:, self._spare] = self._effort[:, :1]
        for _ in range(count):
            self._raw(*self._call)
            self._state[:] = self._next


def impossible_mass(model: Model) -> DataError:
    """What to say of values that no mechanism can have."""
    return DataError(
        "with the current estimate the mass matrix is not positive definite, so that nothing "
        "can be simulated",
        where=f"model of '{model.robot.name}'",
        fix="log a more exciting motion, filter it more, or use another estimator",
    )

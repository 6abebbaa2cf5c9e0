"""States of a robot and what a model's functions are there, for self-tests of exported code."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from steelyard.application.controller.functions import Controller, Function
from steelyard.arrays import Array
from steelyard.kernel.program.numpy_backend import run
from steelyard.kernel.quantities.passive_joints import passive_positions, random_positions


@dataclass(frozen=True, eq=False)
class States:
    """States of the joints: first at zero or at the first position, at rest; then random.

    Attributes:
        arrays: `q`, `passive`, `dq`, `ddq` and `tau`, each of shape `(entries, N)`.
    """

    arrays: Mapping[str, Array]

    @classmethod
    def random(cls, controller: Controller, count: int, seed: int = 0) -> "States":
        """Some states of a robot; half turns are among those of trees."""
        robot, rng = controller.model.robot, np.random.default_rng(seed)
        q, passive = random_positions(robot, count, rng)
        dq, ddq, tau = (_short(size * rng.normal(size=q.shape)) for size in (1.0, 3.0, 10.0))
        dq[:, 0] = ddq[:, 0] = 0.0
        if not robot.passive:
            q = _short(q)
            q[:, 0], q[:, 1:2] = 0.0, np.float32(np.pi)
        return cls({"q": q, "passive": passive, "dq": dq, "ddq": ddq, "tau": tau})

    def results(self, function: Function) -> Array:
        """What a function without memory is there, shape `(entries, N)`."""
        return run(function.program, [self.arrays[x.name] for x in function.program.inputs])


@dataclass(frozen=True, eq=False)
class Path:
    """Consecutive samples of a motion, and the efforts of a model with memory.

    Attributes:
        arrays: `q`, `passive`, `dq` and `ddq`, each of shape `(entries, N)`.
        tau: Shape `(n, N)`.
    """

    arrays: Mapping[str, Array]
    tau: Array

    @classmethod
    def of(cls, controller: Controller, count: int) -> "Path":
        """A motion near the reference configuration that reverses, and begins at some speed."""
        robot = controller.model.robot
        functions = {function.name: function for function in controller.functions}
        rates = 5.0 + np.arange(robot.n)[:, None]
        phase = rates * 0.02 * np.arange(count)
        q = _short(robot.assembly[: robot.n, None] + 0.05 * np.sin(phase))
        arrays = {
            "q": q,
            "passive": passive_positions(robot, q),
            "dq": _short(0.05 * rates * np.cos(phase)),
            "ddq": _short(-0.05 * rates**2 * np.sin(phase)),
        }
        efforts, memory = [], _at(functions["begun"], arrays, 0)
        for k in range(count):
            found = _at(functions["stepped"], {**arrays, "memory": memory[:, None]}, k)
            efforts.append(found[: robot.n])
            memory = found[robot.n :]
        return cls(arrays, np.array(efforts).T)


@dataclass(frozen=True, eq=False)
class Observed:
    """Consecutive samples of a motion, and the external efforts that an observer finds.

    Attributes:
        t: Time, shape `(N,)` [s]; one step is a gap.
        arrays: `q`, `passive`, `dq` and `tau`, each of shape `(entries, N)`.
        external: Shape `(n, N)`.
    """

    t: Array
    arrays: Mapping[str, Array]
    external: Array

    @classmethod
    def of(cls, controller: Controller, count: int, rate: float, longest: float) -> "Observed":
        """A motion near the reference configuration, with a gap in the middle.

        Args:
            controller: The model.
            count: Number of samples.
            rate: Bandwidth of the observer [rad/s].
            longest: Longest step that is no gap [s].
        """
        functions = {function.name: function for function in controller.functions}
        t: Array = 0.4 * longest * np.arange(count, dtype=np.float64)
        t[count // 2 :] += 2.0 * longest
        q, dq = _reversing(controller, t)
        phase = np.arange(1.0, controller.model.robot.n + 1.0)[:, None] * np.arange(count)
        arrays = {
            "q": q,
            "passive": passive_positions(controller.model.robot, q),
            "dq": dq,
            "tau": _short(5.0 * np.cos(phase)),
        }
        n, state = len(q), np.zeros(0)
        found = []
        for k in range(count):
            since = t[k] - t[k - 1]
            if begins := k == 0 or since > longest:
                kept = np.zeros(3 * n)
                kept[2 * n :] = dq[:, k]
                state = np.concatenate([kept, np.zeros(n)])
                if controller.n_memory:
                    state = np.concatenate([state, _at(functions["begun"], arrays, k)])
            left, inverse = (1.0, 0.0) if begins else (np.exp(-rate * since), 1.0 / since)
            names = ("momentum", "drive", "slow", "torque", "memory")
            parts = dict(zip(names, np.split(state, [n, 2 * n, 3 * n, 4 * n]), strict=True))
            scalars = np.array([left, inverse, rate])
            given = {name: x[:, None] for name, x in (parts | {"scalars": scalars}).items()}
            state = _at(functions["observed"], {**arrays, **given}, k)
            found.append(state[3 * n : 4 * n])
        return cls(t, arrays, np.array(found).T)


def _reversing(controller: Controller, t: Array) -> tuple[Array, Array]:
    """Positions and velocities of a motion near the reference configuration, `(n, N)`."""
    robot = controller.model.robot
    rates = 5.0 + np.arange(robot.n)[:, None]
    q = robot.assembly[: robot.n, None] + 0.05 * np.sin(rates * t)
    return _short(np.asarray(q)), _short(np.asarray(0.05 * rates * np.cos(rates * t)))


def _at(function: Function, arrays: Mapping[str, Array], sample: int) -> Array:
    """A function's results at one sample; an array of one sample holds at all."""
    given = [arrays[x.name] for x in function.program.inputs]
    return run(function.program, [x[:, min(sample, x.shape[1] - 1)][:, None] for x in given])[:, 0]


def _short(x: Array) -> Array:
    """Values that single precision holds exactly: a step between positions is then exact too."""
    return x.astype(np.float32).astype(np.float64)

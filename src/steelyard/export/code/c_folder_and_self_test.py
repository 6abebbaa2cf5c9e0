"""The folder of a C export: header, source, CMakeLists, README, and a self-test of states."""

from collections.abc import Mapping, Sequence

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.external.observer_and_wrench import GAP, PER_PERIOD
from steelyard.export.code.c_header_and_source import CCode, filled
from steelyard.export.code.controller_functions import Controller, Function
from steelyard.model.equations.passive_joints import passive_positions, random_positions
from steelyard.symbolic.program_and_softening import run
from steelyard.symbolic.source_code import c_literal

Arrays = Mapping[str, Array]  # arguments and results by name, each of shape `(entries, N)`


def _random_states(controller: Controller, count: int) -> Arrays:
    """States of the joints: first at zero or at the first position, at rest; then random.

    Half turns are among those of trees.
    """
    robot, rng = controller.model.robot, np.random.default_rng(0)
    q, passive = random_positions(robot, count, rng)
    dq, ddq, tau = (_short(size * rng.normal(size=q.shape)) for size in (1.0, 3.0, 10.0))
    dq[:, 0] = ddq[:, 0] = 0.0
    if not robot.passive:
        q = _short(q)
        q[:, 0], q[:, 1:2] = 0.0, np.float32(np.pi)
    return {"q": q, "passive": passive, "dq": dq, "ddq": ddq, "tau": tau}


def _path(controller: Controller, count: int) -> Arrays:
    """Consecutive samples of a motion that reverses, and the efforts of a model with memory."""
    n = controller.model.robot.n
    functions = {function.name: function for function in controller.functions}
    rates = 5.0 + np.arange(n, dtype=np.float64)[:, None]
    phase = rates * 0.02 * np.arange(count, dtype=np.float64)
    arrays = _near_reference(controller, rates, phase)
    arrays["ddq"] = _short(-0.05 * rates**2 * np.sin(phase))
    efforts, memory = [], _at(functions["begun"], arrays, 0)
    for k in range(count):
        found = _at(functions["stepped"], {**arrays, "memory": memory[:, None]}, k)
        efforts.append(found[:n])
        memory = found[n:]
    return {**arrays, "tau": np.array(efforts).T}


def _observed(controller: Controller, count: int, rate: float, longest: float) -> Arrays:
    """Consecutive samples of a motion, with a gap in the middle, and the external efforts there.

    The bandwidth of the observer is `rate` [rad/s], the longest step without a gap `longest` [s].
    """
    n, state = controller.model.robot.n, np.zeros(0)
    functions = {function.name: function for function in controller.functions}
    t: Array = 0.4 * longest * np.arange(count, dtype=np.float64)
    t[count // 2 :] += 2.0 * longest
    rates = 5.0 + np.arange(n, dtype=np.float64)[:, None]
    arrays = _near_reference(controller, rates, rates * t)
    phase = np.arange(1.0, n + 1.0)[:, None] * np.arange(count)
    arrays["tau"] = _short(5.0 * np.cos(phase))
    found = []
    for k in range(count):
        since = t[k] - t[k - 1]
        if begins := k == 0 or since > longest:
            state = np.concatenate([np.zeros(2 * n), arrays["dq"][:, k], np.zeros(n)])
            if controller.n_memory:
                state = np.concatenate([state, _at(functions["begun"], arrays, k)])
        left, inverse = (1.0, 0.0) if begins else (np.exp(-rate * since), 1.0 / since)
        names = ("momentum", "drive", "slow", "torque", "memory")
        parts = dict(zip(names, np.split(state, [n, 2 * n, 3 * n, 4 * n]), strict=True))
        parts["scalars"] = np.array([left, inverse, rate])
        given = {name: x[:, None] for name, x in parts.items()}
        state = _at(functions["observed"], {**arrays, **given}, k)
        found.append(state[3 * n : 4 * n])
    return {**arrays, "t": t, "external": np.array(found).T}


def _near_reference(controller: Controller, rates: Array, phase: Array) -> dict[str, Array]:
    """Positions and velocities of a motion near the reference configuration."""
    robot = controller.model.robot
    q = _short(robot.assembly[: robot.n, None] + 0.05 * np.sin(phase))
    dq = _short(0.05 * rates * np.cos(phase))
    return {"q": q, "passive": passive_positions(robot, q), "dq": dq}


def _at(function: Function, arrays: Arrays, sample: int) -> Array:
    """A function's results at one sample; an array of one sample holds at all."""
    given = [arrays[x.name] for x in function.program.inputs]
    return run(function.program, [x[:, min(sample, x.shape[1] - 1)][:, None] for x in given])[:, 0]


def _short(x: Array) -> Array:
    """Values that single precision holds exactly: a step between positions is then exact too."""
    return x.astype(np.float32).astype(np.float64)


STATES, SAMPLES = 6, 24

TESTED_BANDWIDTH = 8.0  # of the observer that is tested [Hz]
TOLERANCE = {"double": 1e-10, "float": 1e-4}  # passes, relative to one plus the value's size


def self_test(code: CCode) -> str:
    """A program that ends with 0 if the code computes what Python computes."""
    controller, states = code.controller, _random_states(code.controller, STATES)
    tables: dict[str, Array] = {}
    results: dict[str, Array] = {}
    calls: list[tuple[str, Sequence[tuple[str, int]], list[str]]] = []
    for call, (function, _) in code.functions.items():
        if function.public:
            names = [x.name for x in function.program.inputs]
            tables |= {name: states[name] for name in names}
            found = run(function.program, [states[name] for name in names])
            parts = np.split(found, np.cumsum([size for _, size in function.sizes])[:-1])
            outputs = [name for name, _ in function.sizes]
            results |= {f"{call}_{x}": part for x, part in zip(outputs, parts, strict=True)}
            given = [*(f"{x}[k]" for x in names), *(f"{x}_found" for x in outputs)]
            calls.append((call, function.sizes, given))
    tables = {name: x for name, x in states.items() if name in tables} | results
    seen_t: list[float] = []
    if controller.n_memory:
        path = _path(controller, SAMPLES)
        tables |= {f"path_{x}": path[x] for x in ("q", "dq", "ddq", "tau")}
    if controller.observer is not None:
        rate, longest = 2.0 * np.pi * TESTED_BANDWIDTH, GAP / (PER_PERIOD * TESTED_BANDWIDTH)
        seen = _observed(controller, SAMPLES, rate, longest)
        tables |= {f"seen_{x}": seen[x] for x in ("q", "dq", "tau", "external")}
        seen_t = seen["t"].tolist()
    values = {
        "tables": tables,
        "seen_t": ", ".join(map(c_literal, seen_t)),
        "calls": calls,
        "states": STATES,
        "samples": SAMPLES,
        "tolerance": TOLERANCE[code.precision],
        "tested_bandwidth": TESTED_BANDWIDTH,
    }
    return filled("c/test.c", code.values | values)


def c_files(code: CCode) -> dict[str, str]:
    """Contents by the names of the files."""
    values = {**code.values, "tolerance": TOLERANCE[code.precision]}
    return {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": code.source(),
        f"{code.name}_test.c": self_test(code),
        **{name: filled(f"c/{name}", values) for name in ("CMakeLists.txt", "README.md")},
    }

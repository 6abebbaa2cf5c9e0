"""The folder of a C export: header, source, CMakeLists, README, and a self-test of states."""

from collections.abc import Mapping

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.external.momentum_observer import GAP, PER_PERIOD
from steelyard.export.code.c_header_and_source import CCode, comment, commented, filled, joint_lines
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
    name, real, controller = code.name, code.precision, code.controller
    states = _random_states(controller, STATES)
    public = [(call, function) for call, (function, _) in code.functions.items() if function.public]
    read = {x.name for _, function in public for x in function.program.inputs}
    tables = {x: _table(code, x, array) for x, array in states.items() if x in read}
    checks: list[str] = []
    for call, function in public:
        names = [x.name for x in function.program.inputs]
        results = run(function.program, [states[x] for x in names])
        parts = np.split(results, np.cumsum([size for _, size in function.sizes])[:-1])
        found = {
            f"{x}_found": len(part) for (x, _), part in zip(function.sizes, parts, strict=True)
        }
        expected = [f"{call}_{x}" for x, _ in function.sizes]
        tables |= {x: _table(code, x, part) for x, part in zip(expected, parts, strict=True)}
        declared = "".join(f"        {real} {x}[{size}];\n" for x, size in found.items())
        compared = "".join(
            f"        compare({x}, {table}[k], {size});\n"
            for (x, size), table in zip(found.items(), expected, strict=True)
        )
        given = ", ".join([*(f"{x}[k]" for x in names), *found])
        checks.append(
            f"    for (k = 0; k < {STATES}; ++k) {{\n{declared}"
            f"        {name}_{call}({given});\n{compared}    }}\n"
        )
    if code.passive:
        checks.append(_closing_check(code))
    if controller.n_memory:
        path = _path(controller, SAMPLES)
        for x in ("q", "dq", "ddq", "tau"):
            tables[f"path_{x}"] = _table(code, f"path_{x}", path[x])
        checks.append(_path_check(code))
    if controller.observer is not None:
        rate, longest = 2.0 * np.pi * TESTED_BANDWIDTH, GAP / (PER_PERIOD * TESTED_BANDWIDTH)
        seen = _observed(controller, SAMPLES, rate, longest)
        for x in ("q", "dq", "tau", "external"):
            tables[f"seen_{x}"] = _table(code, f"seen_{x}", seen[x])
        times = ", ".join(c_literal(float(x)) for x in seen["t"])
        tables["seen_t"] = f"static const double seen_t[{SAMPLES}] = {{{times}}};\n\n"
        checks.append(_observer_check(code))
    end = "" if real == "double" else "f"
    return f"""\
{comment([f"Compares {name}.c with values that Python computed; ends with 0 if they agree."])}
#include "{name}.h"

#include <math.h>
#include <stdio.h>

{"".join(tables.values())}
static const {real} allowed = {c_literal(TOLERANCE[real], real)};
static {real} worst = {c_literal(0.0, real)};
static int wrong = 0;

static void compare(const {real} *found, const {real} *expected, int count)
{{
    int i;
    for (i = 0; i < count; ++i) {{
        const {real} size = {c_literal(1.0, real)} + fabs{end}(expected[i]);
        const {real} error = fabs{end}(found[i] - expected[i]) / size;
        /* an error that is no number is not within what is allowed */
        if (!(error <= allowed)) {{
            ++wrong;
        }}
        if (error > worst) {{
            worst = error;
        }}
    }}
}}

int main(void)
{{
    int k;
{"".join(checks)}    printf("{name}: %d values beyond %.3g, largest error %.3g\\n",
           wrong, (double)allowed, (double)worst);
    return wrong == 0 ? 0 : 1;
}}
"""


def _closing_check(code: CCode) -> str:
    """Newton's method comes back from a start nearby."""
    real, p = code.precision, code.passive
    near = c_literal(0.01, real)
    return f"""\
    for (k = 0; k < {STATES}; ++k) {{
        {real} found[{p}], none[1] = {{{c_literal(0.0, real)}}}, gap[1];
        int i;
        for (i = 0; i < {p}; ++i) {{
            found[i] = passive[k][i] + {near};
        }}
        gap[0] = {code.name}_close(q[k], found);
        compare(found, passive[k], {p});
        compare(gap, none, 1);
    }}
"""


def _path_check(code: CCode) -> str:
    n, real = code.controller.model.robot.n, code.precision
    return f"""\
    {{
        {code.name}_state state;
        {code.name}_start(&state, path_q[0], path_dq[0]);
        for (k = 0; k < {SAMPLES}; ++k) {{
            {real} found[{n}];
            {code.name}_step(&state, path_q[k], path_dq[k], path_ddq[k], found);
            compare(found, path_tau[k], {n});
        }}
    }}
"""


def _observer_check(code: CCode) -> str:
    n, real = code.controller.model.robot.n, code.precision
    return f"""\
    {{
        {code.name}_observer observer;
        {code.name}_observer_start(&observer, {c_literal(TESTED_BANDWIDTH)});
        for (k = 0; k < {SAMPLES}; ++k) {{
            {real} found[{n}];
            {code.name}_observer_step(&observer, seen_t[k], seen_q[k], seen_dq[k], seen_tau[k],
                found);
            compare(found, seen_external[k], {n});
        }}
    }}
"""


def _table(code: CCode, name: str, array: Array) -> str:
    """Rows of samples of an array of shape `(entries, N)`."""
    rows = [", ".join(c_literal(float(x), code.precision) for x in row) for row in array.T]
    body = ",\n".join(f"    {{{row}}}" for row in rows)
    head = f"static const {code.precision} {name}[{array.shape[1]}][{len(array)}]"
    return f"{head} = {{\n{body}\n}};\n\n"


def c_files(code: CCode) -> dict[str, str]:
    """Contents by the names of the files."""
    controller, robot = code.controller, code.controller.model.robot
    lines = [commented(line.strip()) for line in joint_lines(robot.coordinates)]
    public = ((call, f, c) for call, (f, c) in code.functions.items() if f.public)
    values = {
        "name": code.name,
        "real": code.precision,
        "robot": commented(robot.name),
        "tolerance": TOLERANCE[code.precision],
        "joints": list(zip(lines, code.joints, strict=True)),
        "functions": [(call, commented(f.meaning), c) for call, f, c in public],
        "passive": code.passive,
        "memory": controller.n_memory,
        "observer": controller.observer,
    }
    return {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": code.source(),
        f"{code.name}_test.c": self_test(code),
        **{name: filled(f"c/{name}", values) for name in ("CMakeLists.txt", "README.md")},
    }

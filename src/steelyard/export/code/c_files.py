"""The folder of a C export: header, source, CMakeLists, README, and a self-test of states."""

from collections.abc import Mapping

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.external.observer import GAP, PER_PERIOD
from steelyard.export.code.c_code import CCode, comment, commented, joint_lines
from steelyard.export.code.functions import Controller, Function
from steelyard.model.equations.passive_joints import passive_positions, random_positions
from steelyard.symbolic.program import run
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
    return {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": code.source(),
        f"{code.name}_test.c": self_test(code),
        "CMakeLists.txt": _cmake(code.name),
        "README.md": _readme(code),
    }


def _cmake(name: str) -> str:
    return f"""\
cmake_minimum_required(VERSION 3.10)
project({name}_dynamics C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library({name}_dynamics STATIC {name}.c)
target_include_directories({name}_dynamics PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
find_library(MATH_LIBRARY m)
if(MATH_LIBRARY)
  target_link_libraries({name}_dynamics PUBLIC ${{MATH_LIBRARY}})
endif()

enable_testing()
add_executable({name}_test {name}_test.c)
target_link_libraries({name}_test PRIVATE {name}_dynamics)
add_test(NAME {name}_test COMMAND {name}_test)
"""


def _readme(code: CCode) -> str:
    controller, name, real = code.controller, code.name, code.precision
    robot = controller.model.robot
    joints = zip(joint_lines(robot.coordinates), code.joints, strict=True)
    rows = "\n".join(
        f"| {commented(line.strip())} | `{name.upper()}_JOINT_{joint.upper()}` |"
        for line, joint in joints
    )
    functions = "\n".join(
        f"| `{name}_{call}` | {commented(f.meaning)} | {c.operations} | {c.stack} |"
        for call, (f, c) in code.functions.items()
        if f.public
    )
    return f"""\
# Dynamics of {commented(robot.name)} in C

{name}.h and {name}.c compute in {real} precision what the identified model computes. They are C99
and C++, need `<math.h>` only, allocate no memory and keep no variables between calls.

    cmake -B build && cmake --build build && ctest --test-dir build
    cc -std=c99 -O2 {name}.c {name}_test.c -lm -o {name}_test && ./{name}_test

`{name}_test` compares the functions with values that Python computed. Compilers that contract
products and sums into one operation (FMA; `-ffp-contract`) change the last bits of results, and
mathematical libraries differ in theirs: compare with a tolerance, as the test does
({TOLERANCE[real]:g} relative to one plus the value's size).

| Joint [position, effort] | number |
|---|---|
{rows}

| Function | result | operations | stack [bytes] |
|---|---|---|---|
{functions}

- Angles are in rad, prismatic positions in m, velocities and accelerations in the same units per s
  and s²; efforts in Nm and N. Matrices are stored row by row. Results must not overlap arguments.
- Arguments are not checked. Beyond 1e5 rad sine and cosine lose digits where a library does not
  reduce angles exactly; Python refuses such angles. Check that arguments are finite numbers:
  results of others are not to be used.
- Base parameters that are zero, removed or not identified, are left out; the header lists the
  others.
- Feedforward takes friction from the desired velocity: friction of the measured velocity changes
  sign with its noise.
{_on_states(code)}"""


def _on_states(code: CCode) -> str:
    """What to know of functions that go from sample to sample."""
    name, numbers, text = code.name, code.controller.observer, ""
    if code.passive:
        text += f"""\
- Closed chains: positions are those of the driven joints. `{name}_follow` finds the passive
  joints at the first sample, `{name}_close` at every further one, from those of the sample
  before; both return the closure error. A passive joint must not move by more than about 0.5 rad
  between two samples.
"""
    if code.controller.n_memory:
        text += f"""\
- Friction remembers the motion: `{name}_start` and `{name}_step` compute the efforts of
  consecutive samples. There is no function of one sample alone for the torque of all terms, for
  friction and for the regressor: without the state they are not defined.
"""
    if numbers is not None:
        text += f"""\
- External efforts: `{name}_observer_start` and `{name}_observer_step` observe them from
  positions, velocities and joint efforts of consecutive samples; times are of type `double`.
"""
    if numbers is not None and numbers.thresholds is not None:
        text += f"""\
  `{name}_observer_contact` compares them with thresholds of contact for
  {numbers.thresholds.rate:.3g} false alarms per hour at {numbers.bandwidth:g} Hz; changes at rest,
  which `steelyard contact` tests as well, are not compared. They are of smoothed motion: take as
  contact what lasts for two samples or more, as velocities jump at abrupt stops.
"""
    return text

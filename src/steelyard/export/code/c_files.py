"""The folder of a C export: header, source, CMakeLists, README, and a self-test of states."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.external.observer import GAP, PER_PERIOD
from steelyard.export.code.c_code import CCode, comment, commented, joint_lines
from steelyard.export.code.functions import Controller, Function
from steelyard.model.equations.passive_joints import passive_positions, random_positions
from steelyard.symbolic.program import run
from steelyard.symbolic.source_code import c_literal


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


STATES, SAMPLES = 6, 24

TESTED_BANDWIDTH = 8.0
"""Of the observer that is tested [Hz]."""

TOLERANCE = {"double": 1e-10, "float": 1e-4}
"""Largest error that passes, relative to one plus the value's size."""


def self_test(code: CCode) -> str:
    """A program that ends with 0 if the code computes what Python computes."""
    name, real = code.name, code.precision
    states = States.random(code.controller, STATES)
    public = [function for function, _ in code.functions.values() if function.public]
    read = {x.name for function in public for x in function.program.inputs}
    tables = {x: _table(code, x, array) for x, array in states.arrays.items() if x in read}
    checks: list[str] = []
    for call, (function, _) in code.functions.items():
        if not function.public:
            continue
        arguments = ", ".join(f"{x.name}[k]" for x in function.program.inputs)
        results, first = states.results(function), 0
        places = []
        for output, size in function.sizes:
            table = f"{call}_{output}"
            tables[table] = _table(code, table, results[first : first + size])
            places.append((output, table, size))
            first += size
        checks.append(_check(code, call, arguments, places))
    if code.state.passive:
        checks.append(_closing_check(code))
    if code.state.memory:
        path = Path.of(code.controller, SAMPLES)
        for x in ("q", "dq", "ddq"):
            tables[f"path_{x}"] = _table(code, f"path_{x}", path.arrays[x])
        tables["path_tau"] = _table(code, "path_tau", path.tau)
        checks.append(_path_check(code))
    if code.observer.numbers is not None:
        rate, longest = 2.0 * np.pi * TESTED_BANDWIDTH, GAP / (PER_PERIOD * TESTED_BANDWIDTH)
        seen = Observed.of(code.controller, SAMPLES, rate, longest)
        for x in ("q", "dq", "tau"):
            tables[f"seen_{x}"] = _table(code, f"seen_{x}", seen.arrays[x])
        tables["seen_external"] = _table(code, "seen_external", seen.external)
        times = ", ".join(c_literal(float(x)) for x in seen.t)
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
static {real} worst = {_zero(code)};
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


def _check(code: CCode, call: str, arguments: str, places: Sequence[tuple[str, str, int]]) -> str:
    results = "".join(f"        {code.precision} {x}_found[{size}];\n" for x, _, size in places)
    given = ", ".join([arguments, *(f"{x}_found" for x, _, _ in places)])
    compared = "".join(
        f"        compare({x}_found, {table}[k], {size});\n" for x, table, size in places
    )
    return (
        f"    for (k = 0; k < {STATES}; ++k) {{\n{results}"
        f"        {code.name}_{call}({given});\n{compared}    }}\n"
    )


def _closing_check(code: CCode) -> str:
    """Newton's method comes back from a start nearby."""
    real, p = code.precision, code.state.passive
    near = c_literal(0.01, real)
    return f"""\
    for (k = 0; k < {STATES}; ++k) {{
        {real} found[{p}], none[1] = {{{_zero(code)}}}, gap[1];
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
    n, real = code.state.n, code.precision
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
    n, real = code.state.n, code.precision
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


def _zero(code: CCode) -> str:
    return c_literal(0.0, code.precision)


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
{_closed(code)}{_memory(code)}{_observer(code)}"""


def _closed(code: CCode) -> str:
    if not code.state.passive:
        return ""
    return f"""\
- Closed chains: positions are those of the driven joints. `{code.name}_follow` finds the passive
  joints at the first sample, `{code.name}_close` at every further one, from those of the sample
  before; both return the closure error. A passive joint must not move by more than about 0.5 rad
  between two samples.
"""


def _observer(code: CCode) -> str:
    numbers = code.observer.numbers
    if numbers is None:
        return ""
    contact = ""
    if numbers.thresholds is not None:
        contact = f"""\
  `{code.name}_observer_contact` compares them with thresholds of contact for
  {numbers.thresholds.rate:.3g} false alarms per hour at {numbers.bandwidth:g} Hz; changes at rest,
  which `steelyard contact` tests as well, are not compared. They are of smoothed motion: take as
  contact what lasts for two samples or more, as velocities jump at abrupt stops.
"""
    return f"""\
- External efforts: `{code.name}_observer_start` and `{code.name}_observer_step` observe them from
  positions, velocities and joint efforts of consecutive samples; times are of type `double`.
{contact}"""


def _memory(code: CCode) -> str:
    if not code.state.memory:
        return ""
    return f"""\
- Friction remembers the motion: `{code.name}_start` and `{code.name}_step` compute the efforts of
  consecutive samples. There is no function of one sample alone for the torque of all terms, for
  friction and for the regressor: without the state they are not defined.
"""

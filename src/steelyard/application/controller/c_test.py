"""A self-test of exported C code: states, and what Python computes there."""

from collections.abc import Sequence

import numpy as np

from steelyard.application.controller.c_code import CCode, comment
from steelyard.application.controller.samples import Observed, Path, States
from steelyard.arrays import Array
from steelyard.estimation.external.momentum import PER_PERIOD
from steelyard.estimation.external.observer import GAP
from steelyard.kernel.native.c99 import literal

STATES, SAMPLES = 6, 24

BANDWIDTH = 8.0
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
        rate, longest = 2.0 * np.pi * BANDWIDTH, GAP / (PER_PERIOD * BANDWIDTH)
        seen = Observed.of(code.controller, SAMPLES, rate, longest)
        for x in ("q", "dq", "tau"):
            tables[f"seen_{x}"] = _table(code, f"seen_{x}", seen.arrays[x])
        tables["seen_external"] = _table(code, "seen_external", seen.external)
        times = ", ".join(literal(float(x)) for x in seen.t)
        tables["seen_t"] = f"static const double seen_t[{SAMPLES}] = {{{times}}};\n\n"
        checks.append(_observer_check(code))
    end = "" if real == "double" else "f"
    return f"""\
{comment([f"Compares {name}.c with values that Python computed; ends with 0 if they agree."])}
#include "{name}.h"

#include <math.h>
#include <stdio.h>

{"".join(tables.values())}
static const {real} allowed = {literal(TOLERANCE[real], real)};
static {real} worst = {_zero(code)};
static int wrong = 0;

static void compare(const {real} *found, const {real} *expected, int count)
{{
    int i;
    for (i = 0; i < count; ++i) {{
        const {real} size = {literal(1.0, real)} + fabs{end}(expected[i]);
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
    near = literal(0.01, real)
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
        {code.name}_observer_start(&observer, {literal(BANDWIDTH)});
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
    rows = [", ".join(literal(float(x), code.precision) for x in row) for row in array.T]
    body = ",\n".join(f"    {{{row}}}" for row in rows)
    head = f"static const {code.precision} {name}[{array.shape[1]}][{len(array)}]"
    return f"{head} = {{\n{body}\n}};\n\n"


def _zero(code: CCode) -> str:
    return literal(0.0, code.precision)

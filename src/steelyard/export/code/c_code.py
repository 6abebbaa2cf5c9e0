"""A model as C99: header, source, their identifiers, a self-test and the folder of all."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, distinct_texts
from steelyard.base.templates import templates_of
from steelyard.estimate.external.contact_thresholds import HOLD, SETTLED
from steelyard.estimate.external.momentum_observer_with_wrench_and_contact import GAP, PER_PERIOD
from steelyard.export.code.controller_functions import Controller, Function
from steelyard.model.equations.passive_joints import ITERATIONS, passive_positions, random_positions
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Coordinate
from steelyard.symbolic.program_and_softening import run
from steelyard.symbolic.source_code import CFunction, Precision, c_function, c_literal

_SIGNS = str.maketrans({"²": "^2", "³": "^3", "√": "sqrt "})  # signs of units


def identifier(text: str, otherwise: str) -> str:
    """Letters, digits and single underscores of a name, with a letter first; never empty.

    `otherwise` stands before a name that begins with a digit, and for one without letters.
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"[^A-Za-z0-9]+", "_", plain).strip("_").lower()
    return name if name[:1].isalpha() else f"{otherwise}_{name}".strip("_")


def identifiers(names: Sequence[str], otherwise: str) -> tuple[str, ...]:
    """One identifier per name, no two alike: later ones get a number."""
    return tuple(distinct_texts(identifier(name, otherwise) for name in names))


def named_functions(controller: Controller) -> dict[str, Function]:
    """The functions of a controller by their identifiers in code."""
    listed = controller.functions
    names = identifiers([function.name for function in listed], "function")
    return dict(zip(names, listed, strict=True))


def commented(text: str) -> str:
    """Text that ends no comment of C and no docstring, in ASCII and on one line."""
    plain = text.translate(_SIGNS).encode("ascii", "backslashreplace").decode()
    for risky, safe in (("\\", "/"), ("*/", "* /"), ("/*", "/ *"), ("??", "? ?"), ('"', "'")):
        plain = plain.replace(risky, safe)
    return " ".join(plain.split())


TEMPLATES = Path(__file__).parent / "templates"


def filled(template: str, values: Mapping[str, Any]) -> str:
    """A file's text: a template whose brackets and braces are its language's, with values."""
    return str(_templates().get_template(template).render(values))


@cache
def _templates() -> Any:
    return templates_of(
        TEMPLATES,
        variable_start_string="[[",
        variable_end_string="]]",
        block_start_string="[%",
        block_end_string="%]",
        keep_trailing_newline=True,
    )


def values_of(controller: Controller) -> dict[str, Any]:
    """What templates of all languages are filled with."""
    robot, regressor = controller.model.robot, "regressor" in named_functions(controller)
    return {
        "n": robot.n,
        "parameters": controller.parameters if regressor else None,
        "passive": len(robot.passive),
        "assembly": loop_equations(robot).assembly.tolist() if robot.passive else (),
        "iterations": ITERATIONS,
        "closing_steps": CLOSING_STEPS,
        "memory": controller.n_memory,
        "observer": controller.observer,
        "hold": HOLD,
        "settled": SETTLED,
        "longest": (GAP, PER_PERIOD),
    }


COMMENT_WIDTH = 94  # columns of text in comments
CLOSING_STEPS = 64  # steps from the reference configuration of closed chains to other positions

CLOSING_TOLERANCE = {"double": 1e-8, "float": 1e-4}
"""A last Newton step [rad; m]: the error after it is of the order of its square."""

NO_THRESHOLD = 1e30  # threshold of a joint that has none [Nm; N]


@dataclass(frozen=True, eq=False)
class CCode:
    """A model as C code; `origin` says where it comes from, one line each."""

    controller: Controller
    precision: Precision
    origin: tuple[str, ...]

    @cached_property
    def name(self) -> str:
        """Prefix of all names."""
        return identifier(self.controller.model.robot.name, "robot")

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Identifiers of the joints."""
        return identifiers(self.controller.model.robot.joint_names, "joint")

    @cached_property
    def functions(self) -> Mapping[str, tuple[Function, CFunction]]:
        """The functions by their names in C, without the prefix."""
        return {
            name: (f, c_function(f.program, f"{self.name}_{name}", f.sizes, self.precision))
            for name, f in named_functions(self.controller).items()
        }

    @property
    def stack(self) -> int:
        """Bytes of local variables of the function with most of them."""
        return max(c.stack for _, c in self.functions.values())

    @cached_property
    def values(self) -> dict[str, Any]:
        """What templates of C are filled with."""
        controller, real = self.controller, self.precision
        robot, known = controller.model.robot, controller.observer
        lines = [commented(line.strip()) for line in joint_lines(robot.coordinates)]
        public = ((call, f, c) for call, (f, c) in self.functions.items() if f.public)
        limits = None if known is None or known.thresholds is None else known.thresholds.limits
        return {
            "name": self.name,
            "real": real,
            "end": "" if real == "double" else "f",
            "literal": partial(c_literal, precision=real),
            "in_double": c_literal,
            "listed": lambda row: ", ".join(c_literal(x, real) for x in row),
            "comment": comment,
            "robot": commented(robot.name),
            "joints": list(zip(lines, self.joints, strict=True)),
            "functions": [(call, commented(f.meaning), c) for call, f, c in public],
            "loops": len(robot.loops),
            "closing_tolerance": CLOSING_TOLERANCE[real],
            "observed": ("momentum", "drive", "slow", "external"),
            "limits": None if limits is None else np.where(np.isnan(limits), NO_THRESHOLD, limits),
            "no_threshold": NO_THRESHOLD,
            **values_of(controller),
        }

    def header(self) -> str:
        """The header file."""
        known = self.values["parameters"]
        rows = () if known is None else zip(known.names, known.units, known.values, strict=True)
        columns = [f"  {k} {name} = {x:.9g} {unit}" for k, (name, unit, x) in enumerate(rows)]
        words = ["Base parameters in the order of the regressor's columns:", *columns]
        return filled("c/code.h", {**self.values, "head": comment(self._head()), "columns": words})

    def source(self) -> str:
        """The source file."""
        bodies = [c.text if f.public else f"static {c.text}" for f, c in self.functions.values()]
        return filled("c/code.c", {**self.values, "bodies": bodies}).rstrip("\n") + "\n"

    def _head(self) -> list[str]:
        robot = self.controller.model.robot
        laws = ", ".join(term.law for term in self.controller.model.terms)
        passive = ", ".join(joint.name for joint in robot.passive)
        return [
            f"Dynamics of robot '{robot.name}', written by steelyard.",
            *self.origin,
            "",
            f"Terms: {laws}.",
            "Joints in the order of all arrays, units of position and effort:",
            *joint_lines(robot.coordinates),
            *([f"Passive joints, in the order of arrays 'passive': {passive}."] if passive else []),
            "Matrices are stored row by row. Results must not overlap arguments.",
            f"Needs <math.h> only; at most {self.stack} bytes of local variables a function.",
        ]


def joint_lines(coordinates: Sequence[Coordinate]) -> list[str]:
    """Number, name and units of every joint."""
    return [f"  {k} {c.name} [{c.unit}, {c.effort_unit}]" for k, c in enumerate(coordinates)]


def comment(lines: Sequence[str]) -> str:
    """Lines of a comment in C."""
    rows: list[str] = []
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()))
        rows += wrap(
            commented(line), COMMENT_WIDTH, initial_indent=indent, subsequent_indent=indent
        ) or [""]
    return "\n".join(["/*", *(f" * {row}".rstrip() for row in rows), " */"])


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

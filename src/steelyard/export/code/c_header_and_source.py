"""A model as C99: the header, the source and their identifiers."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from steelyard.estimate.external.contact_thresholds import HOLD, SETTLED
from steelyard.estimate.external.observer_and_wrench import GAP, PER_PERIOD
from steelyard.export.code.controller_functions import Controller, Function
from steelyard.model.equations.passive_joints import ITERATIONS
from steelyard.report.page import templates_of
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Coordinate
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
    found: list[str] = []
    for name in names:
        plain = candidate = identifier(name, otherwise)
        count = 1
        while candidate in found:
            count += 1
            candidate = f"{plain}_{count}"
        found.append(candidate)
    return tuple(found)


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
    def passive(self) -> int:
        """Number of passive joints."""
        return len(self.controller.model.robot.passive)

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
        functions = self.functions.values()
        bodies = [c.text if f.public else f"static {c.text}" for f, c in functions]
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

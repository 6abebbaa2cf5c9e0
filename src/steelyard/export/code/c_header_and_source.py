"""A model as C99: the header, the source and their identifiers."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from textwrap import wrap
from typing import Any

from steelyard.export.code.c_functions_with_state import closing_code, memory_code, observer_code
from steelyard.export.code.controller_functions import Controller, Function
from steelyard.report.page import templates_of
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


COMMENT_WIDTH = 94  # columns of text in comments


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

    @cached_property
    def _of_samples(self) -> list[tuple[str, str]]:
        """Declarations and definitions of functions that go from sample to sample."""
        name, real, robot = self.name, self.precision, self.controller.model.robot
        texts = (
            self._parameters(),
            closing_code(name, real, robot),
            memory_code(name, real, robot, self.controller.n_memory),
            observer_code(name, real, self.controller),
        )
        return [text for text in texts if any(text)]

    @property
    def stack(self) -> int:
        """Bytes of local variables of the function with most of them."""
        return max(c.stack for _, c in self.functions.values())

    def header(self) -> str:
        """The header file."""
        guard = f"{self.name.upper()}_H"
        declared = []
        for function, c in self.functions.values():
            if function.public:
                meaning = function.meaning[0].upper() + function.meaning[1:]
                note = f"{meaning}; {c.operations} operations, {c.stack} bytes of stack."
                declared += [comment([note]), f"{c.signature};", ""]
        parts = (
            comment(self._head()),
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
            *self._joint_numbers(),
            *declared,
            *(declared for declared, _ in self._of_samples),
            "#ifdef __cplusplus",
            "}",
            "#endif",
            "",
            f"#endif /* {guard} */",
        )
        return "\n".join(parts) + "\n"

    def source(self) -> str:
        """The source file."""
        functions = [
            c.text if function.public else f"static {c.text}"
            for function, c in self.functions.values()
        ]
        parts = (
            comment([f"See {self.name}.h."]),
            f'#include "{self.name}.h"',
            "",
            "#include <math.h>",
            "",
            *functions,
            *(defined for _, defined in self._of_samples),
        )
        return "\n".join(parts).rstrip("\n") + "\n"

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

    def _joint_numbers(self) -> list[str]:
        upper = self.name.upper()
        numbers = [
            f"    {upper}_JOINT_{joint.upper()} = {k}" for k, joint in enumerate(self.joints)
        ]
        return [
            f"#define {upper}_JOINTS {len(self.joints)}",
            "",
            f"enum {self.name}_joint {{",
            ",\n".join(numbers),
            "};",
            "",
        ]

    def _parameters(self) -> tuple[str, str]:
        """The function of base parameters: its declaration and definition."""
        if "regressor" not in self.functions:
            return "", ""
        known, real = self.controller.parameters, self.precision
        head = f"void {self.name}_parameters({real} values[{len(known)}])"
        rows = zip(known.names, known.units, known.values, strict=True)
        lines = [f"  {k} {name} = {x:.9g} {unit}" for k, (name, unit, x) in enumerate(rows)]
        words = ["Base parameters in the order of the regressor's columns:", *lines]
        declared = (
            f"#define {self.name.upper()}_PARAMETERS {len(known)}\n\n{comment(words)}\n{head};\n"
        )
        values = (f"    values[{k}] = {c_literal(x, real)};\n" for k, x in enumerate(known.values))
        return declared, f"{head}\n{{\n{''.join(values)}}}\n"


def joint_lines(coordinates: Sequence[Coordinate]) -> list[str]:
    """Number, name and units of every joint."""
    return [f"  {k} {c.name} [{c.unit}, {c.effort_unit}]" for k, c in enumerate(coordinates)]


def joint_list(coordinates: Sequence[Coordinate]) -> str:
    """The same as a list of Markdown."""
    return "\n".join(f"- {commented(line.strip())}" for line in joint_lines(coordinates))


def comment(lines: Sequence[str]) -> str:
    """Lines of a comment in C."""
    rows: list[str] = []
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()))
        rows += wrap(
            commented(line), COMMENT_WIDTH, initial_indent=indent, subsequent_indent=indent
        ) or [""]
    return "\n".join(["/*", *(f" * {row}".rstrip() for row in rows), " */"])

"""Published Denavit-Hartenberg tables in Python source: parsed, never run; and Pinocchio's arm.

The source is that of the Robotics Toolbox: `RevoluteDH(d=..., a=..., alpha=..., m=..., r=...,
I=...)` and the like in a robot's `__init__`, with arithmetic over names assigned there.
"""

import ast
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from steelyard.base.arrays import Array
from steelyard.robot.file.toml_schema import tomllib

KINDS = {
    "RevoluteDH": ("revolute", "standard"),
    "RevoluteMDH": ("revolute", "modified"),
    "PrismaticDH": ("prismatic", "standard"),
    "PrismaticMDH": ("prismatic", "modified"),
}
_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
}
_FUNCTIONS = {f.__name__: f for f in (math.sin, math.cos, math.sqrt, math.radians)}


class NoTable(ValueError):
    """The source makes its table by code that is not arithmetic."""


@dataclass(frozen=True)
class Row:
    """A row; `inertia` is about the centre of mass, shape `(3, 3)`."""

    kind: str
    convention: str
    a: float
    alpha: float
    d: float
    theta: float
    mass: float
    com: Array
    inertia: Array


def rows_of_source(path: Path) -> list[Row]:
    """The table of a robot's `__init__`.

    Raises:
        NoTable: It is made in a loop, or of values that are computed otherwise.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    begin = next(
        (f for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) and f.name == "__init__"), None
    )
    if begin is None:
        raise NoTable("no robot")
    names: dict[str, Any] = {"pi": math.pi, "zero": 0.0}
    rows: list[Row] = []
    for statement in begin.body:
        _take(statement, names, rows)
    if not rows or len({row.convention for row in rows}) > 1:
        raise NoTable("no table of one convention")
    return rows


def _take(statement: ast.stmt, names: dict[str, Any], rows: list[Row]) -> None:
    calls = [c for c in ast.walk(statement) if isinstance(c, ast.Call) and _name(c.func) in KINDS]
    if calls and not isinstance(statement, ast.Assign):
        raise NoTable("made in a loop or a branch")
    rows += [_row(call, names) for call in sorted(calls, key=lambda c: (c.lineno, c.col_offset))]
    if isinstance(statement, ast.Assign) and not calls:
        for target in statement.targets:
            if isinstance(target, ast.Name):
                try:
                    names[target.id] = _value(statement.value, names)
                except NoTable:
                    names.pop(target.id, None)


def _row(call: ast.Call, names: dict[str, Any]) -> Row:
    kind, convention = KINDS[_name(call.func)]
    wanted = ("a", "alpha", "d", "theta", "offset", "m", "r", "I")
    given = {k.arg: _value(k.value, names) for k in call.keywords if k.arg in wanted}
    sliding = kind == "prismatic"
    return Row(
        kind,
        convention,
        float(given.get("a", 0.0)),
        float(given.get("alpha", 0.0)),
        float(given.get("offset", 0.0) if sliding else given.get("d", 0.0)),
        float(given.get("theta", 0.0) if sliding else given.get("offset", 0.0)),
        float(given.get("m", 0.0)),
        np.array(given.get("r", np.zeros(3)), dtype=np.float64),
        _matrix(np.array(given.get("I", np.zeros(6)), dtype=np.float64)),
    )


def _matrix(numbers: Array) -> Array:
    """Of nine numbers, `xx, yy, zz` or `xx, yy, zz, xy, yz, xz`."""
    if numbers.size == 9:
        return numbers.reshape(3, 3)
    xx, yy, zz, xy, yz, xz = (*numbers.ravel(), 0.0, 0.0, 0.0)[:6]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def _value(node: ast.expr, names: dict[str, Any]) -> Any:
    """A number or an array of arithmetic."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return node.value
    if isinstance(node, ast.List | ast.Tuple):
        return np.array([_value(item, names) for item in node.elts])
    if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_value(node.operand, names))
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        both = _value(node.left, names), _value(node.right, names)
        return _OPERATORS[type(node.op)](*both)
    if isinstance(node, ast.Call) and _name(node.func) in ("array", *_FUNCTIONS):
        inside = _value(node.args[0], names)
        return inside if _name(node.func) == "array" else _FUNCTIONS[_name(node.func)](inside)
    if isinstance(node, ast.Attribute) and node.attr == "pi":
        return math.pi
    if isinstance(node, ast.Name) and node.id in names:
        return names[node.id]
    raise NoTable(f"line {node.lineno} is more than arithmetic")


def rows_of_robot_file(path: Path) -> list[Row]:
    """The table of a robot file's `[robot.dh]`."""
    section = tomllib.loads(path.read_text(encoding="utf-8"))["robot"]["dh"]
    angle = math.pi / 180.0 if section.get("angle_unit") == "deg" else 1.0
    return [
        Row(
            link.get("kind", "revolute"),
            section["convention"],
            link.get("a", 0.0),
            link.get("alpha", 0.0) * angle,
            link.get("d", 0.0),
            link.get("theta", 0.0) * angle,
            link.get("mass", 0.0),
            np.array(link.get("com", np.zeros(3))),
            _tensor(link.get("inertia_com", np.zeros(6))),
        )
        for link in section["links"]
    ]


def _tensor(six: Sequence[float]) -> Array:
    """Of the robot file's `Ixx, Ixy, Iyy, Ixz, Iyz, Izz`."""
    xx, xy, yy, xz, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def robot_file(rows: Sequence[Row]) -> str:
    """A robot file with the table."""
    lines = ["[robot]", "[robot.dh]", f'convention = "{rows[0].convention}"']
    for row in rows:
        i = row.inertia
        six = [i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2]]
        numbers = {name: getattr(row, name) for name in ("a", "alpha", "d", "theta", "mass")}
        numbers |= {"com": row.com.tolist(), "inertia_com": [float(x) for x in six]}
        lines += ["[[robot.dh.links]]", f'kind = "{row.kind}"']
        lines += [f"{name} = {value!r}" for name, value in numbers.items()]
    return "\n".join(lines) + "\n"


def pinocchio_arm(rows: Sequence[Row]) -> Any:
    """Pinocchio's model of the chain, its joints named `joint_1` and so on."""
    model = pin.Model()
    parent, before = 0, pin.SE3.Identity()
    for number, row in enumerate(rows, start=1):
        screw_x = pin.SE3(pin.AngleAxis(row.alpha, np.array([1.0, 0.0, 0.0])).matrix(),
                          np.array([row.a, 0.0, 0.0]))  # fmt: skip
        screw_z = pin.SE3(pin.AngleAxis(row.theta, np.array([0.0, 0.0, 1.0])).matrix(),
                          np.array([0.0, 0.0, row.d]))  # fmt: skip
        joint = pin.JointModelPZ() if row.kind == "prismatic" else pin.JointModelRZ()
        standard = row.convention == "standard"
        placement = before if standard else screw_x * screw_z
        parent = model.addJoint(parent, joint, placement, f"joint_{number}")
        before = screw_z * screw_x if standard else pin.SE3.Identity()
        body = pin.Inertia.Zero()
        body.mass, body.lever, body.inertia = row.mass, row.com, row.inertia
        model.appendBodyToJoint(parent, body, before)
    return model

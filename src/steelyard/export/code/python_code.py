"""A model as one Python file, which needs NumPy alone."""

from steelyard.export.code.c_code import (
    CLOSING_TOLERANCE,
    commented,
    filled,
    joint_lines,
    named_functions,
    values_of,
)
from steelyard.export.code.controller_functions import Controller, Function
from steelyard.symbolic.source_code import Syntax, source_of

SYNTAX = Syntax(
    {
        "add": "{0} + {1}",
        "sub": "{0} - {1}",
        "mul": "{0} * {1}",
        "div": "{0} / {1}",
        "neg": "-{0}",
        "less": "1.0 * ({0} < {1})",
        "less_equal": "1.0 * ({0} <= {1})",
        "minimum": "np.minimum({0}, {1})",
        "maximum": "np.maximum({0}, {1})",
        "atan": "np.arctan({0})",
        **{name: f"np.{name}({{0}})" for name in ("sqrt", "abs", "sign", "sin", "cos", "exp")},
        "tanh": "np.tanh({0})",
    },
    lambda value: repr(value) if value >= 0.0 else f"({value!r})",
    "    {0} = {1}",
)


def python_code(controller: Controller, origin: tuple[str, ...]) -> str:
    """The file's text."""
    robot, known = controller.model.robot, controller.observer
    functions = named_functions(controller)
    laws = ", ".join(term.law for term in controller.model.terms)
    head = [
        f"Dynamics of robot '{robot.name}', written by steelyard; needs NumPy alone.",
        "",
        *origin,
        f"Terms: {laws}.",
        "Joints in the order of all arrays, units of position and effort:",
        *joint_lines(robot.coordinates),
        "",
        "Arguments are one state, shape (n,), or one a row, (N, n); results likewise.",
    ]
    limits = [] if known is None or known.thresholds is None else known.thresholds.limits.tolist()
    values = {
        "head": "\n".join(
            " " * (len(line) - len(line.lstrip())) + commented(line) for line in head
        ).strip(),
        **values_of(controller),
        "joints": robot.joint_names,
        "functions": [(name, f, _lines(f)) for name, f in functions.items()],
        "results": _results,
        "commented": commented,
        "quoted": repr,
        "closing_tolerance": CLOSING_TOLERANCE["double"],
        "limits": [[None if x != x else x for x in row] for row in limits],
    }
    return filled("python/dynamics.txt", values)


def _lines(function: Function) -> list[str]:
    """Statements of a function, without zeros: they are there already."""
    places = [f"found[{k}]" for k in range(sum(size for _, size in function.sizes))]
    return [
        line
        for line in source_of(function.program, places, SYNTAX)[0]
        if not (line.startswith("    found[") and line.endswith("= 0.0"))
    ]


def _results(function: Function) -> str:
    results, first = [], 0
    for (_, shape), (_, size) in zip(function.outputs, function.sizes, strict=True):
        part = f"np.moveaxis(found[{first}:{first + size}], 0, -1)"
        if len(shape) > 1:
            part += f".reshape(*q.shape[1:], {', '.join(map(str, shape))})"
        results.append(part)
        first += size
    return ", ".join(results)

"""Expressions of xacro files: their values, limits of size, and the functions and methods on them.

Xacro itself hands expressions to Python. Here the syntax tree is walked instead, and what is not
listed below does not exist: no attribute of any object but entries of tables, no function but
`FUNCTIONS`, no method but `METHODS`.
"""

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any

TEXT = 100_000  # characters of a text, and of a list or table with all that is in it
BITS = 4096  # binary digits of a whole number


class XacroError(Exception):
    """What is wrong in a xacro file, and how to correct it; its place is added by the caller."""

    def __init__(self, wrong: str, fix: str = "") -> None:
        super().__init__(wrong)
        self.wrong = wrong
        self.fix = fix or "correct the expression there"


def _too_long(what: str) -> XacroError:
    return XacroError(f"{what} is longer than {TEXT} characters")


class Budget:
    """The work that one expansion may take: elements, parts of expressions, characters."""

    def __init__(self, steps: int = 2_000_000) -> None:
        self.left = steps

    def spend(self, steps: int) -> None:
        """Take some of it; `XacroError` if there is none left."""
        self.left -= steps
        if self.left < 0:
            raise XacroError(
                "the file grows without end: its expansion was given up",
                "look for a macro or a property that repeats itself",
            )


def bounded(value: Any, budget: Budget) -> Any:
    """The value itself; `XacroError` if it is too large."""
    if isinstance(value, int) and value.bit_length() > BITS:
        raise XacroError(f"a whole number has more than {BITS} binary digits")
    if isinstance(value, complex):
        raise XacroError("a number is complex")
    size = _size(value, TEXT)
    if size > TEXT:
        raise _too_long("a text or a list")
    budget.spend(size // 16)
    return value


def _size(value: Any, most: int) -> int:
    """Characters, roughly; counted no further than a little beyond `most`."""
    size, waiting = 0, [value]
    while waiting and size <= most:
        part = waiting.pop()
        if isinstance(part, str):
            size += len(part)
        elif isinstance(part, list | tuple | set):
            size += 8 + 8 * len(part)
            waiting.extend(part if size <= most else ())
        elif isinstance(part, dict):
            size += 8 + 16 * len(part)
            inside: Iterable[Any] = (*part.keys(), *part.values()) if size <= most else ()
            waiting.extend(inside)
    return size


def literal(value: Any) -> Any:
    """A text as the number, truth value or quoted text that it writes, as xacro reads it."""
    if not isinstance(value, str):
        return value
    if len(value) >= 2 and value[0] == value[-1] == "'":
        return value[1:-1]
    if "_" in value:
        return value
    for reading in (int, float):
        with suppress(ValueError):
            return reading(value)
    return {"true": True, "True": True, "false": False, "False": False}.get(value, value)


def as_truth(value: Any, text: str) -> bool:
    """The truth of a condition; `XacroError` if it has none."""
    if not isinstance(value, str):
        return bool(value)
    if value in ("true", "True", "false", "False"):
        return value.lower() == "true"
    try:
        return bool(int(value))
    except ValueError:
        raise XacroError(
            f"the condition '{text}' gives '{value[:80]}', which is neither true nor false",
            "let it give true, false or a number",
        ) from None


def remainder(left: Any, right: Any) -> Any:
    """`left % right` of numbers, or numbers in a text; `XacroError` if it may be wide."""
    if not isinstance(left, str):
        return left % right
    if "*" in left or re.search(r"\d{4}", left):
        raise XacroError(f"the format '{left[:80]}' is not supported: it may be wide")
    if left.count("%") * _size(right, TEXT) > 10 * TEXT:
        raise _too_long("a text")
    return left % (tuple(right) if isinstance(right, list) else right)


def power(base: Any, exponent: Any) -> Any:
    """`base ** exponent`; `XacroError` instead of giant whole numbers."""
    whole = isinstance(base, int) and isinstance(exponent, int) and exponent > 0
    if whole and base.bit_length() * exponent > 2 * BITS:
        raise XacroError(f"a power has more than {BITS} binary digits")
    return base**exponent


def product(left: Any, right: Any) -> Any:
    """`left * right`; `XacroError` instead of giant texts or lists."""
    for many, times in ((left, right), (right, left)):
        repeated = isinstance(many, str | list | tuple) and isinstance(times, int)
        if repeated and len(many) * times > TEXT:
            raise _too_long("a text or a list")
    return left * right


def rounded(number: Any, digits: int = 0) -> Any:
    """Python's `round`, with a sensible number of digits."""
    if not math.isfinite(number) or abs(digits) > 300:
        raise XacroError(f"{number} cannot be rounded to {digits} digits")
    return round(number, digits) if digits else round(number)


def counted(*bounds: int) -> list[int]:
    """Python's `range`, as a list."""
    numbers = range(*bounds)
    if numbers.__len__() > TEXT // 8:
        raise _too_long("a text or a list")
    return list(numbers)


_MATH = (
    "acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh degrees exp fabs floor fmod "
    "hypot isclose isfinite isinf isnan log log10 log2 pow radians sin sinh sqrt tan tanh trunc"
)
MATH: Mapping[str, Any] = {
    **{name: getattr(math, name) for name in _MATH.split()},
    "pi": math.pi,
    "e": math.e,
    "tau": math.tau,
    "inf": math.inf,
    "nan": math.nan,
}
_BUILT_IN = (abs, all, any, bool, dict, float, int, len, list, max, min, sorted, str, sum, tuple)
PYTHON: Mapping[str, Any] = {
    **{function.__name__: function for function in _BUILT_IN},
    "enumerate": lambda *given: list(enumerate(*given)),
    "range": counted,
    "round": rounded,
    "zip": lambda *given: list(zip(*given, strict=False)),
}
FUNCTIONS: Mapping[str, Any] = {
    **MATH,
    **PYTHON,
    "true": True,
    "false": False,
    "math": MATH,
    "python": PYTHON,
}
"""Names that every expression knows."""


def _replaced(text: str, old: str, new: str) -> str:
    if (len(text) // max(len(old), 1) + 1) * len(new) > TEXT:
        raise _too_long("a text")
    return text.replace(old, new)


def _joined(text: str, parts: list[str]) -> str:
    if len(text) * len(parts) > TEXT:
        raise _too_long("a text")
    return text.join(parts)


METHODS: Mapping[type, Mapping[str, Callable[..., Any]]] = {
    str: {
        **{
            name: getattr(str, name)
            for name in "count endswith find isdigit lower lstrip rstrip split startswith strip "
            "title upper".split()
        },
        "join": _joined,
        "replace": _replaced,
    },
    dict: {
        "get": dict.get,
        "items": lambda table: list(table.items()),
        "keys": lambda table: list(table),
        "values": lambda table: list(table.values()),
    },
    list: {"count": list.count, "index": list.index},
    tuple: {"count": tuple.count, "index": tuple.index},
}
"""Methods, by the type of the value before the dot."""

LENGTH = 4000  # characters of one expression

_OPERATIONS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: product,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: remainder,
    ast.Pow: power,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}


class Names:
    """What names of an expression stand for; as a value, a namespace: `arm.length`."""

    def value(self, name: str) -> Any:
        """The value of a name; `XacroError` if it has none."""
        if name in FUNCTIONS:
            return FUNCTIONS[name]
        raise XacroError(f"'{name}' is not defined", f"define '{name}' before it is used")


def evaluate(text: str, names: Names, budget: Budget) -> Any:
    """The value of an expression; `XacroError` if it has none, does too much or is too large."""
    shown = text if len(text) < 200 else f"{text[:200]}..."
    try:
        if len(text) > LENGTH:
            raise XacroError(f"an expression is longer than {LENGTH} characters")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(text.strip(), mode="eval")
        return _Evaluation(names, budget).of(tree.body)
    except XacroError as error:
        raise XacroError(f"expression '{shown}': {error.wrong}", error.fix) from None
    except (RecursionError, MemoryError):
        raise XacroError(f"expression '{shown}' is nested too deeply") from None
    except SyntaxError:
        raise XacroError(f"'{shown}' is not an expression") from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise XacroError(f"expression '{shown}': {str(error)[:200]}") from None


class _Evaluation:
    def __init__(self, names: Names, budget: Budget) -> None:
        self.names = names
        self.budget = budget
        self.own: dict[str, Any] = {}

    def of(self, node: ast.expr) -> Any:
        self.budget.spend(1)
        visit = getattr(self, f"_{type(node).__name__.lower()}", None)
        if visit is None:
            kind = type(node).__name__.lower()
            raise XacroError(f"'{kind}' is not supported in expressions", _FIX)
        return visit(node)

    def _made(self, value: Any) -> Any:
        return bounded(value, self.budget)

    def _constant(self, node: ast.Constant) -> Any:
        if node.value is not None and not isinstance(node.value, int | float | str):
            raise XacroError(f"the constant {node.value!r:.40} is not supported", _FIX)
        return self._made(node.value)

    def _name(self, node: ast.Name) -> Any:
        return self.own[node.id] if node.id in self.own else self.names.value(node.id)

    def _attribute(self, node: ast.Attribute) -> Any:
        if node.attr.startswith("_"):
            raise XacroError(f"'{node.attr}' is not accessible", _FIX)
        inside = self.of(node.value)
        if isinstance(inside, Mapping):
            if node.attr not in inside:
                raise XacroError(f"there is no entry '{node.attr}'")
            return inside[node.attr]
        if isinstance(inside, Names):
            return inside.value(node.attr)
        raise XacroError(f"'{node.attr}' is not accessible", _FIX)

    def _binop(self, node: ast.BinOp) -> Any:
        return self._made(self._operation(node.op)(self.of(node.left), self.of(node.right)))

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        return self._made(self._operation(node.op)(self.of(node.operand)))

    def _boolop(self, node: ast.BoolOp) -> Any:
        wanted = isinstance(node.op, ast.Or)
        value: Any = None
        for part in node.values:
            value = self.of(part)
            if bool(value) is wanted:
                break
        return value

    def _compare(self, node: ast.Compare) -> Any:
        left = self.of(node.left)
        for kind, comparator in zip(node.ops, node.comparators, strict=True):
            right = self.of(comparator)
            if not self._operation(kind)(left, right):
                return False
            left = right
        return True

    def _operation(self, kind: Any) -> Any:
        if type(kind) not in _OPERATIONS:
            name = type(kind).__name__.lower()
            raise XacroError(f"the operation '{name}' is not supported", _FIX)
        return _OPERATIONS[type(kind)]

    def _ifexp(self, node: ast.IfExp) -> Any:
        return self.of(node.body if self.of(node.test) else node.orelse)

    def _subscript(self, node: ast.Subscript) -> Any:
        inside = self.of(node.value)
        if not isinstance(inside, str | list | tuple | dict):
            raise XacroError("only texts, lists and tables have entries")
        key = self.of(node.slice)
        if isinstance(inside, dict) and key not in inside:
            raise XacroError(f"there is no entry '{str(key)[:80]}'")
        return inside[key]

    def _slice(self, node: ast.Slice) -> slice:
        return slice(*(part and self.of(part) for part in (node.lower, node.upper, node.step)))

    def _list(self, node: ast.List) -> list[Any]:
        return self._made([self.of(part) for part in node.elts])  # type: ignore[no-any-return]

    def _tuple(self, node: ast.Tuple) -> tuple[Any, ...]:
        return tuple(self._list(ast.List(node.elts)))

    def _dict(self, node: ast.Dict) -> Any:
        if None in node.keys:
            raise XacroError("'**' is not supported in expressions", _FIX)
        pairs = zip(node.keys, node.values, strict=True)
        return self._made({self.of(k): self.of(v) for k, v in pairs if k is not None})

    def _listcomp(self, node: ast.ListComp | ast.GeneratorExp) -> list[Any]:
        if len(node.generators) != 1 or not isinstance(node.generators[0].target, ast.Name):
            raise XacroError("only one loop over one name is supported in expressions", _FIX)
        loop, kept = node.generators[0], []
        name, before = node.generators[0].target.id, dict(self.own)
        for value in list(self.of(loop.iter)):
            self.own[name] = value
            if all(self.of(condition) for condition in loop.ifs):
                kept.append(self.of(node.elt))
        self.own = before
        return self._made(kept)  # type: ignore[no-any-return]

    _generatorexp = _listcomp

    def _call(self, node: ast.Call) -> Any:
        function = self._function(node.func)
        if any(isinstance(part, ast.Starred) for part in node.args):
            raise XacroError("'*' is not supported in expressions", _FIX)
        given = [self.of(part) for part in node.args]
        named = {part.arg: self.of(part.value) for part in node.keywords if part.arg}
        values = [value for value in (*given, *named.values()) if value is not None]
        plain = all(isinstance(x, int | float | str | list | tuple | dict) for x in values)
        if len(named) < len(node.keywords) or not plain:
            raise XacroError("a function is not given plain values", _FIX)
        return self._made(function(*given, **named))

    def _function(self, node: ast.expr) -> Callable[..., Any]:
        if isinstance(node, ast.Attribute):
            inside = self.of(node.value)
            methods = METHODS.get(type(inside), {})
            if node.attr in methods:
                method = methods[node.attr]
                return lambda *given: method(inside, *given)
        function = self.of(node)
        if not callable(function):
            raise XacroError(f"'{ast.unparse(node)[:80]}' is not a function", _FIX)
        return function  # type: ignore[no-any-return]


_FIX = "write it with numbers, texts, lists and the functions of docs/robot-file.md"

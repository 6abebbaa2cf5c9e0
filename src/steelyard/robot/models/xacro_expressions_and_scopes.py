"""Expressions of xacro files, and the scope of properties, blocks and macros they are read in.

Xacro itself hands expressions to Python. Here the syntax tree is walked instead, and what is not
listed below does not exist: no attribute of any object but entries of tables, no function but
`FUNCTIONS`, no method but `METHODS`.
"""

import ast
import operator
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from steelyard.robot.models.xacro_values_and_functions import (
    FUNCTIONS,
    METHODS,
    Budget,
    XacroError,
    bounded,
    literal,
    power,
    product,
    remainder,
)
from steelyard.robot.models.xml_reader import Element

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

_PIECE = re.compile(
    r"(?P<escaped>\$\$+[{(])|\$\{(?P<expression>[^}]*)\}"
    r"|\$\((?P<command>(?:[^()]|\((?:[^()]|\([^()]*\))*\))*)\)|[^$]+|\$"
)


@dataclass(frozen=True)
class Macro:
    """A macro; a default is a property of the caller to be forwarded and a text, or `None`."""

    body: Element
    parameters: tuple[str, ...]
    defaults: dict[str, tuple[str | None, str | None]]


@dataclass(frozen=True)
class Reading:
    """What all scopes of one expansion share; `command` gives the text of `$(...)` in a scope."""

    budget: Budget
    command: Callable[[str, "Scope"], Any]
    functions: dict[str, Callable[..., Any]]


@dataclass(eq=False)
class Scope(Names):
    """Names of one file, namespace (an include with `ns`) or call of a macro."""

    reading: Reading
    parent: "Scope | None" = None
    namespace: bool = False
    values: dict[str, Any] = field(default_factory=dict)
    lazy: dict[str, str] = field(default_factory=dict)
    blocks: dict[str, Element] = field(default_factory=dict)
    macros: dict[str, Macro] = field(default_factory=dict)
    waiting: list[str] = field(default_factory=list)

    def above(self) -> Iterator["Scope"]:
        """This scope and those around it, the nearest first."""
        scope: Scope | None = self
        while scope is not None:
            yield scope
            scope = scope.parent

    def holder(self, name: str) -> "Scope | None":
        """The scope that defines a property."""
        return next((s for s in self.above() if name in s.values or name in s.lazy), None)

    def value(self, name: str) -> Any:
        """The value of a name in expressions; a lazy property is evaluated now."""
        scope = self.holder(name)
        if scope is not None:
            return scope._evaluated(name)
        if name == "xacro":
            return self.reading.functions
        if name in self.reading.functions:
            return self.reading.functions[name]
        return super().value(name)

    def _evaluated(self, name: str) -> Any:
        if name in self.lazy:
            if name in self.waiting:
                way = " -> ".join([*self.waiting, name])
                raise XacroError(
                    f"properties are defined by each other: {way[:200]}",
                    "remove the circular definition",
                )
            self.waiting.append(name)
            try:
                self.values[name] = literal(self.text(self.lazy[name]))
            finally:
                self.waiting.remove(name)
            del self.lazy[name]
        return self.values[name]

    def set(self, name: str, value: Any, lazy: bool = False) -> None:
        """Define a property; a lazy text is evaluated when it is used first."""
        value = literal(value)
        self.lazy.pop(name, None)
        self.values.pop(name, None)
        if lazy and isinstance(value, str):
            self.lazy[name] = value
        else:
            self.values[name] = value

    def remove(self, name: str) -> None:
        """Undefine a property, here and above."""
        for scope in self.above():
            scope.values.pop(name, None)
            scope.lazy.pop(name, None)

    def text(self, text: str) -> Any:
        """A text with its `${...}` and `$(...)` evaluated; a single one keeps its type."""
        # every '$' may be looked at to the end of the text
        self.reading.budget.spend(1 + len(text) * (8 + text.count("$")) // 128)
        results = []
        for match in _PIECE.finditer(text):
            if (escaped := match["escaped"]) is not None:
                results.append(escaped[1:])
            elif (expression := match["expression"]) is not None:
                inner = str(self.text(expression))
                results.append(evaluate(inner, self, self.reading.budget))
            elif (command := match["command"]) is not None:
                results.append(self.reading.command(str(self.text(command)), self))
            else:
                results.append(match[0])
        if len(results) > 1 and any(callable(part) for part in results):
            raise XacroError(f"'{text[:80]}' writes a function, not a value")
        whole = results[0] if len(results) == 1 else "".join(map(str, results))
        return bounded(whole, self.reading.budget)

    def macro(self, name: str) -> tuple[Macro, "Scope"]:
        """A macro, and the scope around its call: this one, or the namespace of `arm.link`."""
        for scope in self.above():
            if name in scope.macros:
                return scope.macros[name], self
        first, dot, rest = name.partition(".")
        inside = self.value(first) if dot and self.holder(first) else None
        if isinstance(inside, Scope):
            return inside.macro(rest)
        known = sorted({n for s in self.above() for n in s.macros})
        raise XacroError(
            f"there is no macro '{name}'",
            "define or include it before it is used; "
            + (f"the macros are {', '.join(known)[:300]}" if known else "there are no macros"),
        )

    def block(self, name: str) -> Sequence[Element]:
        """What `<xacro:insert_block>` inserts: `**name` only the content, `*name` all of it."""
        for mark in ("**", "*"):
            for scope in self.above():
                if mark + name in scope.blocks:
                    block = scope.blocks[mark + name]
                    return block.children if mark == "**" else [block]
        raise XacroError(f"there is no block '{name}'", "give it to the macro, or define it before")

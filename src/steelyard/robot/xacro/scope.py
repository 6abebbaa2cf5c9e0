"""Properties, blocks and macros of a xacro file, and the texts that are made with them."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from steelyard.robot.xacro.expression import Names, evaluate
from steelyard.robot.xacro.values import (
    Budget,
    XacroError,
    bounded,
    literal,
    whole_text,
)
from steelyard.robot.xml_reader import Element

_PIECE = re.compile(
    r"(?P<escaped>\$\$+[{(])|\$\{(?P<expression>[^}]*)\}"
    r"|\$\((?P<command>(?:[^()]|\((?:[^()]|\([^()]*\))*\))*)\)|[^$]+|\$"
)


@dataclass(frozen=True)
class Macro:
    """A macro: its body, and its parameters with their defaults.

    `defaults`: parameter to (name of the caller's property to be forwarded, text), either `None`.
    """

    body: Element
    parameters: tuple[str, ...]
    defaults: dict[str, tuple[str | None, str | None]]


@dataclass(frozen=True)
class Reading:
    """What all scopes of one expansion share.

    Attributes:
        budget: The work left.
        command: The text that `$(...)` stands for, from what is inside and the scope.
        functions: `xacro.load_yaml` and others, by name.
    """

    budget: Budget
    command: Callable[[str, "Scope"], Any]
    functions: dict[str, Callable[..., Any]]


@dataclass(eq=False)
class Scope(Names):
    """Names of one file, namespace or call of a macro.

    Attributes:
        reading: What all scopes share.
        parent: Where names are looked for that are not here.
        namespace: Whether it was made by an include with `ns`.
    """

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
        return bounded(whole_text(results), self.reading.budget)

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

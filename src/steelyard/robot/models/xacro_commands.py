"""Commands `$(...)` of xacro files, and scopes of their properties, blocks and macros.

The environment is not read, so a file means the same on every computer: `$(optenv NAME VALUE)` is
the value, and `$(env NAME)` an argument of that name.
"""

import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from steelyard.base.errors import ModelError
from steelyard.robot.models import xacro_expressions
from steelyard.robot.models.xacro_expressions import Budget, Names, XacroError, evaluate, literal
from steelyard.robot.models.xml_and_urdf import Element, read_bytes, read_xml


@dataclass(frozen=True)
class Packages:
    """Where packages are: in folders that the robot file names, and above the model file."""

    given: tuple[Path, ...]
    model: Path

    def find(self, name: str) -> Path:
        """The folder of a package; `XacroError` if there is none."""
        if re.fullmatch(r"[\w-][\w.-]*", name):
            for place in (*self.given, *self.model.resolve().parents, *self._environment()):
                for folder in (place / name, place):
                    if os.path.isdir(folder) and (
                        folder.name == name or package_name(folder) == name
                    ):
                        return folder
            for place in self.given:
                for manifest in sorted(place.glob("*/package.xml")):
                    if package_name(manifest.parent) == name:
                        return manifest.parent
        places = [str(place) for place in (*self.given, *self._environment())]
        looked = ", ".join(["the folders above the file", *places])
        raise XacroError(
            f"the package '{name}' is not found; looked in {looked}",
            'name the folder that holds it: [robot.xacro] packages = ["FOLDER"] in the robot file, '
            "or ROS_PACKAGE_PATH=FOLDER in the environment",
        )

    def named(self, text: str, folder: Path) -> Path:
        """A file as models name it: `package://...`, absolute, or relative to a folder.

        Copies of packages often have other names, so it may lie below a folder above the model all
        the same.
        """
        text = text.removeprefix("file://")
        if not text.startswith("package://"):
            return folder / text
        name, _, rest = text.removeprefix("package://").partition("/")
        try:
            return self.find(name) / rest
        except XacroError:
            for above in self.model.resolve().parents:
                if os.path.isfile(above / rest):
                    return above / rest
            raise

    def _environment(self) -> list[Path]:
        """`ROS_PACKAGE_PATH` of ROS 1, `AMENT_PREFIX_PATH` of ROS 2."""
        ros1 = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
        ros2 = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        return [Path(p) for p in ros1 if p] + [Path(p) / "share" for p in ros2 if p]


def package_name(folder: Path) -> str | None:
    """The name in a folder's `package.xml`; `None` where there is none."""
    manifest = folder / "package.xml"
    if not os.path.isfile(manifest):
        return None
    try:
        names = read_xml(manifest).all("name")
    except ModelError:
        return None
    return "".join(names[0].texts).strip() if names else None


UNITS = {
    "!radians": 1.0,
    "!degrees": math.pi / 180.0,
    "!meters": 1.0,
    "!millimeters": 0.001,
    "!foot": 0.3048,
    "!inches": 0.0254,
}
TRUTHS = {
    word: truth
    for truth, words in (("true", "yes on"), ("false", "no off"))
    for one in words.split()
    for word in (one, one.capitalize(), one.upper())
}
"""Truth values of YAML 1.1, which xacro reads; `y` and `n` are names there, as of coordinates."""
LARGEST = 20_000  # values in a file, with those that are repeated by reference


def load_yaml(path: Path, budget: Budget) -> Any:
    """Tables, lists and scalars of a YAML file; nothing else is constructed.

    A value with a unit, `!degrees 90`, is an expression.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    fix = "give the YAML file that the xacro file came with"
    if path.suffix.lower() not in (".yaml", ".yml") or not os.path.isfile(path):
        raise XacroError(f"there is no YAML file '{path}'", fix)
    yaml = YAML(typ="safe", pure=True)
    try:
        content = read_bytes(path, "a YAML file")
        if len(content) > 1_000_000:
            raise XacroError(f"'{path}' is larger than 1 MB", fix)
        node = yaml.compose(content.decode("utf-8-sig"))
        if node is None:
            return {}
        _prepare(node, budget, {}, ())
        return yaml.constructor.construct_document(node)
    except ModelError as error:
        raise XacroError(f"'{path}': {error.wrong}", fix) from None
    except (YAMLError, ValueError, TypeError, RecursionError) as error:
        words = " ".join(str(error).split())[:200]
        raise XacroError(f"'{path}' is not plain YAML: {words}", fix) from None


def _prepare(node: Any, budget: Budget, sizes: dict[int, int], above: tuple[int, ...]) -> int:
    """Turn values with units into numbers, words into truths; how many values there are."""
    if id(node) in above:
        raise ValueError("a value contains itself")
    if id(node) in sizes:
        return sizes[id(node)]
    if node.tag == "tag:yaml.org,2002:str" and node.style is None and node.value in TRUTHS:
        node.tag, node.value = "tag:yaml.org,2002:bool", TRUTHS[node.value]
    if node.tag in UNITS:
        value = float(evaluate(str(node.value), Names(), budget)) * UNITS[node.tag]
        node.tag = "tag:yaml.org,2002:float"
        node.value = repr(value)
    parts = node.value if isinstance(node.value, list) else []
    inside = [part for entry in parts for part in (entry if isinstance(entry, tuple) else (entry,))]
    size = 1 + sum(_prepare(part, budget, sizes, (*above, id(node))) for part in inside)
    if size > LARGEST:
        raise ValueError(f"there are more than {LARGEST} values")
    sizes[id(node)] = size
    return size


GIVE = (
    "give it behind the file, {name}:=VALUE, or in the robot file: "
    "[robot.xacro] arguments = {{{name} = VALUE}}"
)


class Commands(Names):
    """Arguments of the file with defaults of those declared so far, and what it may ask for."""

    def __init__(self, packages: Packages, arguments: dict[str, str], files: list[Path]) -> None:
        self.packages = packages
        self.arguments = arguments
        self.declared: set[str] = set()
        self.files = files
        self.budget = Budget()
        self.found: dict[str, str] = {}
        self.functions: dict[str, Callable[..., Any]] = {
            "arg": self.argument,
            "abs_filename": lambda name: str(self._path(name)),
            "dotify": dict,
            "fatal": _fatal,
            "load_yaml": lambda name: load_yaml(self._path(name), self.budget),
            "tokenize": _tokens,
            **dict.fromkeys(("error", "message", "warning"), lambda *words: ""),
        }

    def value(self, name: str) -> Any:
        """What a name in `$(eval ...)` stands for: the arguments, beside the functions."""
        if name in self.arguments:
            return literal(self.argument(name))
        if name == "arg":
            return lambda name: literal(self.argument(name))
        return self.find if name == "find" else super().value(name)

    def of(self, command: str) -> Any:
        """What stands for `$(command)`; `XacroError` if it is not known, or cannot be had."""
        name, _, rest = command.strip().partition(" ")
        words = rest.split()
        if name == "eval":
            return evaluate(rest, self, self.budget)
        if name == "optenv" and words:
            return " ".join(words[1:])
        if name == "dirname" and not words:
            return str(self.files[-1].resolve().parent)
        if name in ("arg", "find", "env") and len(words) == 1:
            return self.find(words[0]) if name == "find" else self.argument(words[0])
        raise XacroError(
            f"$({command[:80]}) is not supported",
            "$(arg NAME), $(find PACKAGE), $(eval ...), $(dirname), $(env NAME) and "
            "$(optenv NAME VALUE) are",
        )

    def argument(self, name: str) -> str:
        """The text of an argument."""
        self.declared.add(name)
        if name not in self.arguments:
            raise XacroError(f"the argument '{name}' is not given", GIVE.format(name=name))
        return self.arguments[name]

    def find(self, package: str) -> str:
        """A package; `package://NAME` if missing: it may only hold meshes."""
        if package not in self.found:
            try:
                self.found[package] = str(self.packages.find(package))
            except XacroError:
                self.found[package] = f"package://{package}"
        return self.found[package]

    def included(self, name: str, optional: bool) -> list[Path]:
        """The files that an include names; several where the last part is a pattern."""
        path = self._path(name)
        if re.search(r"[*?\[]", path.name) and os.path.isdir(path.parent):
            return sorted(p for p in path.parent.glob(path.name.replace("**", "*")) if p.is_file())
        if os.path.isfile(path):
            return [path]
        if optional:
            return []
        raise XacroError(
            f"the file '{path}' to be included does not exist",
            "keep the folders as the package has them, or correct the path",
        )

    def _path(self, name: str) -> Path:
        return self.packages.named(name, self.files[-1].parent)


def _fatal(*words: Any) -> NoReturn:
    raise XacroError(
        f"the file raised an error: {' '.join(map(str, words))[:300]}", "change its arguments"
    )


def _tokens(text: str, sep: str = ",; ", skip_empty: bool = True) -> list[str]:
    parts = re.split(f"[{re.escape(sep)}]", text) if sep else [text]
    return [part for part in parts if part] if skip_empty else parts


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


@dataclass(eq=False)
class Scope(Names):
    """Names of one file, namespace (an include with `ns`) or call of a macro."""

    commands: Commands
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
            return self.commands.functions
        if name in self.commands.functions:
            return self.commands.functions[name]
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
        self.commands.budget.spend(1 + len(text) * (8 + text.count("$")) // 128)
        results = []
        for match in _PIECE.finditer(text):
            if (escaped := match["escaped"]) is not None:
                results.append(escaped[1:])
            elif (expression := match["expression"]) is not None:
                inner = str(self.text(expression))
                results.append(evaluate(inner, self, self.commands.budget))
            elif (command := match["command"]) is not None:
                results.append(self.commands.of(str(self.text(command))))
            else:
                results.append(match[0])
        if len(results) > 1 and any(callable(part) for part in results):
            raise XacroError(f"'{text[:80]}' writes a function, not a value")
        whole = results[0] if len(results) == 1 else "".join(map(str, results))
        return xacro_expressions.bounded(whole, self.commands.budget)

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

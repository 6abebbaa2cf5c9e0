"""Xacro files as URDF: expanded in this process, without ROS and without running what they say.

Macros, properties, conditions and includes become plain elements, as the program `xacro` 2 does it,
but for what a file from a stranger must not do: see `xacro_expressions` for `${...}`,
`xacro_commands` for `$(...)`. Files are only read.

A reference is a model file with its arguments behind it, as for the program `xacro`:
`arm.urdf.xacro name:=left hand:=false`.
"""

import atexit
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree import ElementTree

from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.base.files import cache_folder, whole_file
from steelyard.robot.models.xacro_commands import Commands, Macro, Packages, Scope
from steelyard.robot.models.xacro_expressions import XacroError, as_truth
from steelyard.robot.models.xml_and_urdf import Element, of_xacro, read_xml, xacro_name

_ARGUMENT = re.compile(r"\s+(?=[A-Za-z_]\w*:=)")


@dataclass(frozen=True)
class Expansion:
    """A URDF made of a xacro file, as `note` says; meshes have absolute paths, but in `sha256`."""

    path: Path
    sha256: str
    note: str


def split_reference(reference: str | Path) -> tuple[Path, dict[str, str]]:
    """The file and the arguments of `FILE NAME:=VALUE...`."""
    path, *given = _ARGUMENT.split(str(reference))
    pairs = (words.split(":=", 1) for words in given)
    return Path(path), {name: value.strip() for name, value in pairs}


def joined_reference(path: Path, arguments: Mapping[str, str]) -> str:
    """The inverse of `split_reference`."""
    return " ".join([str(path), *(f"{name}:={value}" for name, value in arguments.items())])


def stem_of(reference: str | Path) -> str:
    """A model file's name without its endings and arguments: `arm` of `arm.urdf.xacro`."""
    path = split_reference(reference)[0]
    return Path(path.stem).stem if path.suffix.lower() == ".xacro" else path.stem


def is_xacro(path: Path) -> bool:
    """Whether a model file has to be expanded: by its ending, or by an element that is read."""
    return path.suffix.lower() == ".xacro" or of_xacro(read_xml(path)) is not None


def expand(
    path: Path, arguments: Mapping[str, str], packages: Sequence[Path] = ()
) -> Expansion | None:
    """The URDF that a xacro file stands for with its arguments; `None` for a file that is none.

    Packages are looked for in the folders given, those above the file and those of the environment.
    """
    if not is_xacro(path):
        if arguments:
            raise ModelError(
                f"'{path}' is not a xacro file, and has no arguments",
                where=joined_reference(path, arguments),
                fix="leave out the arguments after it",
            )
        return None
    places = Packages(tuple(packages), path)
    expander = Expander(places, arguments)
    root = expander.root()
    for name in arguments:
        known, wrong = sorted(expander.commands.declared), f"the file has no argument '{name}'"
        refuse_unknown(name, known, wrong, str(path), "arguments")
    _check_robot(path, root, expander.macros)
    portable = _xml(root, lambda name: name)
    words = " ".join(f"{name}:={value}" for name, value in arguments.items())
    return Expansion(
        _kept(_xml(root, lambda name: _mesh_path(name, places)), stem_of(path), root.tag),
        hashlib.sha256(portable).hexdigest(),
        f"{path.name} is expanded with {words or 'no arguments'}",
    )


def _check_robot(path: Path, root: Element, macros: set[str]) -> None:
    if root.children and root.tag == "mujoco" or root.all("link"):
        return
    if not macros:
        raise ModelError(
            "the file holds no links", where=str(path), fix="give the file of the whole robot"
        )
    users = _users(path)
    listed = f"here {', '.join(users)}" if users else "often NAME.urdf.xacro, or in ../robots"
    raise ModelError(
        f"the file only defines macros ({', '.join(sorted(macros))[:200]}), and no robot",
        where=str(path),
        fix=f"give the file that includes it and calls them: {listed}",
    )


def _users(path: Path) -> list[str]:
    folder = path.resolve().parent
    nearby = [*folder.glob("*.xacro"), *folder.parent.glob("*/*.xacro")][:200]
    found = []
    for file in sorted({file.resolve() for file in nearby}):
        try:
            text = file.read_text("utf-8", "replace")
        except OSError:
            continue
        if file.name != path.name and re.search(rf"[/\"]{re.escape(path.name)}\"", text):
            found.append(os.path.relpath(file, folder))
    return found[:5]


def _mesh_path(name: str, packages: Packages) -> str:
    """A mesh's path from anywhere; as it is where the file is not found."""
    try:
        path = packages.named(name, packages.model.parent).resolve()
    except (XacroError, OSError):
        return name
    return path.as_posix() if path.is_file() else name


def _xml(root: Element, mesh: Callable[[str], str]) -> bytes:
    """The text of an XML file, its meshes named by a function."""
    made = _element(root, mesh)
    ElementTree.indent(made)
    return bytes(ElementTree.tostring(made, "utf-8", xml_declaration=True))


def _element(element: Element, mesh: Callable[[str], str]) -> ElementTree.Element:
    attributes = dict(element.attributes)
    if element.tag == "mesh" and "filename" in attributes:
        attributes["filename"] = mesh(attributes["filename"])
    made = ElementTree.Element(element.tag, attributes)
    made.text = "".join(element.texts).strip() or None
    made.extend([_element(child, mesh) for child in element.children])
    return made


def _kept(content: bytes, stem: str, tag: str) -> Path:
    """The content in a file of its own, in the cache."""
    key = hashlib.sha256(content).hexdigest()[:16]
    folder = cache_folder("models")
    if folder is None or not os.access(folder, os.W_OK):
        folder = _temporary()
    path = folder / key / f"{stem}{'.xml' if tag == 'mujoco' else '.urdf'}"
    if not path.is_file() or path.read_bytes() != content:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part:
            part.write_bytes(content)
    return path


@cache
def _temporary() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="steelyard-models-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


DEPTH = 100  # elements, macros and files inside each other
FILES = 1000  # files that one expansion may include
_PARAMETER = re.compile(
    r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?"
    r"(\$\{.*?\}|\$\(.*?\)|(?:'[^']*'|\"[^\"]*\"|[^\s'\"])+|)(?:\s+|$)(.*)",
    re.DOTALL,
)


class Expander:
    """One expansion; `macros` are the names of all macros that were defined."""

    def __init__(self, packages: Packages, arguments: Mapping[str, str]) -> None:
        self.files = [packages.model]
        self.commands = Commands(packages, dict(arguments), self.files)
        self.scope = Scope(self.commands)
        self.macros: set[str] = set()
        self.included = 0
        self.depth = 0
        self.calls: list[str] = []

    def root(self) -> Element:
        """The outermost element; its own name comes last, often an argument from inside."""
        root = read_xml(self.files[0])
        try:
            with self._place(root):
                changed = dict[str, str]()
                children = self._inside(root, self.scope, changed)
                attributes = self._attributes(root, self.scope) | changed
                return replace(
                    root, attributes=MappingProxyType(attributes), children=children, texts=[]
                )
        except RecursionError:
            raise ModelError(
                "macros or elements are nested too deeply",
                where=str(self.files[0]),
                fix="look for a macro that calls itself without end",
            ) from None

    @contextmanager
    def _place(self, element: Element) -> Iterator[None]:
        """One level further in; errors there state their place."""
        self.depth += 1
        try:
            self.scope.commands.budget.spend(1)
            if self.depth > DEPTH:
                raise XacroError(
                    f"macros, includes and elements are nested more than {DEPTH} times",
                    "look for a macro that calls itself, or a file that includes itself",
                )
            yield
        except XacroError as error:
            where = f"{element.path}, line {element.line}"
            calls = "".join(f", called in {call}" for call in self.calls[:-4:-1])
            raise ModelError(error.wrong, where=where + calls, fix=error.fix) from None
        finally:
            self.depth -= 1

    def _plain(self, element: Element, scope: Scope, tag: str | None = None) -> Element:
        attributes = self._attributes(element, scope)
        children = self._inside(element, scope, attributes)
        texts = [str(scope.text("".join(element.texts)))] if element.texts else []
        proxy = MappingProxyType(attributes)
        return replace(
            element, tag=tag or element.tag, attributes=proxy, children=children, texts=texts
        )

    def _attributes(self, element: Element, scope: Scope) -> dict[str, str]:
        return {
            name: str(scope.text(text))
            for name, text in element.attributes.items()
            if xacro_name(name) is None
        }

    def _inside(
        self, element: Element, scope: Scope, attributes: dict[str, str] | None = None
    ) -> list[Element]:
        """What is inside an element, expanded; `<xacro:attribute>` changes the attributes."""
        made = list[Element]()
        for child in element.children:
            with self._place(child):
                made += self._element(child, scope, {} if attributes is None else attributes)
        return made

    def _element(self, element: Element, scope: Scope, attributes: dict[str, str]) -> list[Element]:
        name = xacro_name(element.tag)
        if name is None:
            return [self._plain(element, scope)]
        if name == "attribute":
            key = str(scope.text(_needed(element, "name")))
            attributes[key] = str(scope.text(_needed(element, "value")))
            return []
        if name in ("if", "unless"):
            text = _needed(element, "value")
            wanted = as_truth(scope.text(text), text) is (name == "if")
            return self._inside(element, scope, attributes) if wanted else []
        statement = getattr(self, f"_xacro_{name}", None)
        found: list[Element] = (
            self._called(element, name, scope) if statement is None else statement(element, scope)
        )
        return found

    def _xacro_property(self, element: Element, scope: Scope) -> list[Element]:
        given = element.attributes
        name = str(scope.text(_needed(element, "name")))
        if not name.isidentifier() or name.startswith("__"):
            raise XacroError(f"'{name[:80]}' cannot be the name of a property", "rename it")
        if as_truth(scope.text(given.get("remove", "false")), "remove"):
            scope.remove(name)
            return []
        value = given.get("value")
        if "default" in given and value is None:
            if scope.holder(name) is not None:
                return []
            value = given["default"]
        lazy = as_truth(scope.text(given.get("lazy_eval", "true")), "lazy_eval")
        target = scope
        if given.get("scope") == "global":
            target, lazy = [*scope.above()][-1], False
        elif given.get("scope") == "parent" and scope.parent is not None:
            target, lazy = scope.parent, False
            while not scope.namespace and target.namespace and target.parent is not None:
                target = target.parent
        if value is None:
            target.blocks[f"**{name}"] = element
        else:
            target.set(name, value if lazy else scope.text(value), lazy)
        return []

    def _xacro_arg(self, element: Element, scope: Scope) -> list[Element]:
        name, default = _needed(element, "name"), element.attributes.get("default")
        self.commands.declared.add(name)
        if name not in self.commands.arguments and default is not None:
            self.commands.arguments[name] = str(scope.text(default))
        return []

    def _xacro_include(self, element: Element, scope: Scope) -> list[Element]:
        given, inner = element.attributes, scope
        if "ns" in given:
            inner = Scope(scope.commands, scope, namespace=True)
            scope.set(str(scope.text(given["ns"])), inner)
        optional = as_truth(given.get("optional", "false"), "optional")
        made = list[Element]()
        for path in self.commands.included(str(scope.text(_needed(element, "filename"))), optional):
            self.included += 1
            if self.included > FILES:
                raise XacroError(
                    f"more than {FILES} files are included", "look for a circular include"
                )
            self.files.append(path)
            try:
                made += self._inside(read_xml(path), inner)
            finally:
                self.files.pop()
        return made

    def _xacro_macro(self, element: Element, scope: Scope) -> list[Element]:
        name = _needed(element, "name").removeprefix("xacro:")
        if name in ("", "call") or "." in name:
            raise XacroError(f"'{name}' cannot be the name of a macro", "rename it")
        names, defaults, left = list[str](), {}, element.attributes.get("params", "").strip()
        if len(left) > 10_000:
            raise XacroError(f"macro '{name[:80]}' has too many parameters", "divide the macro")
        while left:
            if match := _PARAMETER.match(left):
                parameter, forward, default, left = match.groups()
                defaults[parameter] = (parameter if forward else None, default or None)
            else:
                parameter, _, left = left.partition(" ") if " " in left else (left, "", "")
            names.append(parameter.strip())
            left = left.strip()
        scope.macros[name] = Macro(element, tuple(names), defaults)
        self.macros.add(name)
        return []

    def _xacro_insert_block(self, element: Element, scope: Scope) -> list[Element]:
        made = list[Element]()
        for inside in scope.block(str(scope.text(_needed(element, "name")))):
            with self._place(inside):
                made += self._element(inside, scope, {})
        return made

    def _xacro_element(self, element: Element, scope: Scope) -> list[Element]:
        """`<xacro:element xacro:name="...">`: an element whose name is computed."""
        names = [v for k, v in element.attributes.items() if xacro_name(k) == "name"]
        tag = str(scope.text(names[0])).strip() if names else ""
        if not re.fullmatch(r"[A-Za-z_][\w.-]*", tag):
            raise XacroError("<xacro:element> has no name", 'write xacro:name="..."')
        return [self._plain(element, scope, tag)]

    def _xacro_call(self, element: Element, scope: Scope) -> list[Element]:
        return self._called(element, str(scope.text(_needed(element, "macro"))), scope, "macro")

    def _called(
        self, element: Element, name: str, scope: Scope, without: str = ""
    ) -> list[Element]:
        scope.commands.budget.spend(20)
        macro, around = scope.macro(name)
        inner = Scope(scope.commands, around)
        for parameter, text in element.attributes.items():
            if parameter == without or xacro_name(parameter) is not None:
                continue
            if parameter not in macro.parameters:
                listed = ", ".join(macro.parameters) or "none"
                raise XacroError(
                    f"macro '{name}' has no parameter '{parameter}'", f"its parameters: {listed}"
                )
            inner.set(parameter, scope.text(text))
        wanted = [p for p in macro.parameters if p.startswith("*")]
        given = self._inside(element, scope)
        if len(wanted) != len(given):
            raise XacroError(
                f"macro '{name}' takes {len(wanted)} blocks, and is given {len(given)}",
                "put as many elements into the call as it has parameters with '*'",
            )
        inner.blocks |= dict(zip(wanted, given, strict=True))
        for parameter in macro.parameters:
            if not parameter.startswith("*") and parameter not in inner.values:
                inner.set(parameter, _default(macro, parameter, name, scope))
        self.calls.append(f"{element.path}, line {element.line}")
        try:
            return self._inside(macro.body, inner)
        finally:
            self.calls.pop()


def _default(macro: Macro, parameter: str, name: str, scope: Scope) -> Any:
    forwarded, text = macro.defaults.get(parameter, (None, None))
    if forwarded is not None and scope.holder(forwarded) is not None:
        return scope.value(forwarded)
    if text is None:
        raise XacroError(
            f"macro '{name}' is not given its parameter '{parameter}'",
            f'write {parameter}="..." into the call',
        )
    return scope.text(text)


def _needed(element: Element, attribute: str) -> str:
    if attribute not in element.attributes:
        name = xacro_name(element.tag)
        raise XacroError(f"<xacro:{name}> has no attribute '{attribute}'", "add it")
    return element.attributes[attribute]

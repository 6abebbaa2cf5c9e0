"""What `$(...)` and the functions `xacro.*` of xacro files stand for.

The environment is not read, so a file means the same on every computer: `$(optenv NAME VALUE)` is
the value, and `$(env NAME)` an argument of that name.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from steelyard.robot.xacro.expression import Names, evaluate
from steelyard.robot.xacro.packages import Packages
from steelyard.robot.xacro.values import Budget, XacroError, literal
from steelyard.robot.xacro.yaml_files import load_yaml

GIVE = (
    "give it behind the file, {name}:=VALUE, or in the robot file: "
    "[robot.xacro] arguments = {{{name} = VALUE}}"
)


class _Arguments(Names):
    """Names in `$(eval ...)`: the arguments, beside the functions."""

    def __init__(self, commands: "Commands") -> None:
        self.commands = commands

    def value(self, name: str) -> Any:
        if name in self.commands.arguments:
            return literal(self.commands.argument(name))
        if name in ("arg", "find"):
            return {"arg": self.commands.literal, "find": self.commands.find}[name]
        return super().value(name)


class Commands:
    """Arguments of the file, and what it may ask for.

    Attributes:
        arguments: Those given, and the defaults of those declared so far.
        declared: Names that the file declares or uses.
        functions: By name, those that expressions know as `xacro.*`.
    """

    def __init__(
        self, packages: Packages, arguments: dict[str, str], files: list[Path], budget: Budget
    ) -> None:
        self.packages = packages
        self.arguments = arguments
        self.declared: set[str] = set()
        self.files = files
        self.budget = budget
        self.found: dict[str, str] = {}
        self.functions: dict[str, Callable[..., Any]] = {
            "arg": self.argument,
            "abs_filename": lambda name: str(self._path(name)),
            "dotify": dict,
            "error": lambda *words: "",
            "fatal": _fatal,
            "load_yaml": self._yaml,
            "message": lambda *words: "",
            "tokenize": _tokens,
            "warning": lambda *words: "",
        }

    def of(self, command: str, scope: Names) -> Any:
        """What stands for `$(command)`.

        Raises:
            XacroError: It is not known, or cannot be had.
        """
        name, _, rest = command.strip().partition(" ")
        words = rest.split()
        if name == "eval":
            return evaluate(rest, _Arguments(self), self.budget)
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

    def literal(self, name: str) -> Any:
        """The value of an argument."""
        return literal(self.argument(name))

    def find(self, package: str) -> str:
        """The folder of a package; `package://NAME` where it is not found.

        So a package that only holds meshes may be missing, and a file of it is requested by name.
        """
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

    def _yaml(self, name: str) -> Any:
        return load_yaml(self._path(name), lambda text: evaluate(text, Names(), self.budget))


def _fatal(*words: Any) -> NoReturn:
    raise XacroError(
        f"the file raised an error: {' '.join(map(str, words))[:300]}", "change its arguments"
    )


def _tokens(text: str, sep: str = ",; ", skip_empty: bool = True) -> list[str]:
    parts = re.split(f"[{re.escape(sep)}]", text) if sep else [text]
    return [part for part in parts if part] if skip_empty else parts

"""Commands made from public functions: from their signatures, bounds and docstrings."""

import functools
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterable, Mapping, Set
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import typer
import typer.main
from typer.core import TyperCommand

from steelyard.cli.command import (
    FixedBase,
    LogArgument,
    LogArguments,
    ModelArgument,
    RobotArgument,
    Seed,
    Threads,
    guarded,
)

SHARED: Mapping[str, Any] = {
    "robot": RobotArgument,
    "model": ModelArgument,
    "logs": LogArguments,
    "log": LogArgument,
    "fixed_base": FixedBase,
    "threads": Threads,
    "seed": Seed,
}
"""Parameters that are the same in every command."""

UNIT_METAVARS = {"seconds": "SECONDS", "kg": "KG", "Hz": "HZ"}
METAVARS = {
    "calibrate": "LOG...",
    "drop": "NAME...",
    "frame": "NAME",
    "keep": "NAME...",
    "loaded": "LOG...",
    "logs": "LOG...",
    "method": "NAME",
    "motion": "MOTION",
    "payload_frame": "NAME",
    "rate": "NUMBER",
    "truth": "FILE",
    "unloaded": "LOG...",
    "validate": "LOG...",
    "wrench_frame": "NAME",
}
"""What stands for a value in the help text, by the parameter's name."""


def from_function(
    home: str, **changes: dict[str, Any] | None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a command from a public function: from its signature, bounds and docstring.

    A parameter without a default is an argument, another one an option: a switch if it is a bool
    (`--no-NAME` if the default is true), one that takes several values if it is a list. Its help
    is in the docstring of the function, its bounds are those of `checked`. The decorated function
    gets the call with these arguments as its first one, and has the other options of the command.

    Args:
        home: Module and name of the function, such as `"steelyard:identify"`. It is imported
            when the command is called or its help is printed.
        changes: What is different on the command line, by the parameter's name: `name` of the
            option, `type`, or arguments of `typer.Option`; `None` for a parameter that it lacks.
    """

    def around(body: Callable[..., None]) -> Callable[..., None]:
        def command() -> None: ...

        command.__name__, command.__doc__ = body.__name__, body.__doc__
        vars(command)["make"] = functools.partial(_made, body, home, changes)
        return command

    return around


class DerivedCommand(TyperCommand):
    """A command of `from_function`, made when its parameters are needed."""

    _made: list[Any] | None = None

    @property
    def params(self) -> list[Any]:
        """Arguments and options."""
        if self._made is None:
            alone = typer.Typer(add_completion=False)
            alone.command()(vars(self.callback)["make"]())
            made = typer.main.get_command(alone)
            self._made, self.callback = made.params, made.callback
        return self._made

    @params.setter
    def params(self, empty: list[Any]) -> None:
        """Typer knows none yet."""


def _made(
    body: Callable[..., None], home: str, changes: Mapping[str, dict[str, Any] | None]
) -> Callable[..., None]:
    """The command as a function with one parameter for each argument and option."""
    function = pkgutil.resolve_name(home)
    own = list(inspect.signature(body).parameters.values())[1:]
    left_out = {"progress", *(p.name for p in own), *(n for n, c in changes.items() if c is None)}
    hints, known = get_type_hints(function), inspect.signature(function).parameters
    options = {name for name, p in known.items() if p.default is not p.empty}
    texts = {name: help_text(t, options) for name, t in argument_texts(function).items()}
    least = getattr(function, "least", {})
    derived = {
        name: _parameter(p, hints[name], texts.get(name, ""), least.get(name), changes.get(name))
        for name, p in known.items()
        if name not in left_out
    }

    @functools.wraps(body)
    def run(**given: Any) -> None:
        arguments = {}
        for name, parameter in derived.items():
            value = given.pop(parameter.name)
            if value is not None or known[name].default is None:
                arguments[name] = value if parameter.name == name else not value
        body(functools.partial(function, **arguments), **given)

    parameters = [*derived.values(), *(p.replace(kind=p.KEYWORD_ONLY) for p in own)]
    vars(run)["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return guarded(run)


def _parameter(
    parameter: inspect.Parameter,
    hint: Any,
    text: str,
    least: float | None,
    changes: Mapping[str, Any] | None,
) -> inspect.Parameter:
    """A parameter as Typer reads it; a switch that is on by default gets the name `no_NAME`."""
    name, default = parameter.name, parameter.default
    if changes is None and name in SHARED:
        return parameter.replace(annotation=SHARED[name], kind=parameter.KEYWORD_ONLY)
    kind = _command_line_type(hint)
    if kind is bool:
        name, default = (f"no_{name}", False) if default else (name, default)
    elif get_origin(kind) is list and default == ():
        kind, default = kind | None, None
    unit = re.search(r" in (seconds|kg|Hz)\b", text)
    told: dict[str, Any] = {
        "name": _option(name),
        "help": text,
        "min": least,
        "metavar": METAVARS.get(parameter.name) or UNIT_METAVARS.get(unit[1] if unit else ""),
        "type": kind,
        **(changes or {}),
    }
    if get_origin(kind) is Literal:
        told["metavar"] = None
    kind, option = told.pop("type"), told.pop("name")
    is_argument = default is parameter.empty and "name" not in (changes or {})
    shown = typer.Argument(**told) if is_argument else typer.Option(option, **told)
    return parameter.replace(
        name=name, default=default, annotation=Annotated[kind, shown], kind=parameter.KEYWORD_ONLY
    )


def _command_line_type(hint: Any) -> Any:
    """A type on the command line: text for paths and models, a list where several are accepted."""
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    if any(isinstance(o := get_origin(k), type) and issubclass(o, Iterable) for k in kinds):
        return list[str]
    if str in kinds:
        return str | None if NoneType in kinds else str
    return hint


def argument_texts(function: Callable[..., Any]) -> dict[str, str]:
    """What the docstring says of each argument, in one line."""
    section = (inspect.getdoc(function) or "").partition("\nArgs:\n")[2].split("\n\n")[0]
    found = re.findall(r"^    (\w+): (.+(?:\n {8}.+)*)", section, re.M)
    return {name: " ".join(text.split()) for name, text in found}


def help_text(text: str, options: Set[str]) -> str:
    """The text of an argument for the command line, which has no `None` and no brackets."""
    text = text.replace("`None`", "unset").replace(" [s]", " in seconds")
    text = re.sub(r" \[([^]]+)\]", lambda unit: f" in {unit[1].replace('; ', ' or ')}", text)
    return re.sub(r"`([^ `]+)`", lambda m: _option(m[1]) if m[1] in options else m[1], text)


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")

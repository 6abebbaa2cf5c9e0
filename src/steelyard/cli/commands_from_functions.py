"""Commands made from functions: from their signatures, bounds and docstrings."""

import ast
import functools
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import typer
import typer.main
from typer.core import TyperCommand

from steelyard.cli.shared_by_commands import LOG_HELP, MODEL_HELP, XACRO_ARGUMENTS_HELP, guarded

SHARED: Mapping[str, Mapping[str, Any]] = {
    "robot": {
        "help": f"Robot file (TOML), URDF, xacro file or MJCF. {XACRO_ARGUMENTS_HELP}",
        "metavar": "ROBOT",
    },
    "model": {"help": MODEL_HELP, "metavar": "MODEL"},
    "logs": {"help": LOG_HELP},
    "log": {"help": LOG_HELP, "metavar": "LOG"},
    "fixed_base": {
        "help": "Link to fix to the world, for a URDF or MJCF with a floating base; in a robot "
        "file, base = ... does this.",
        "metavar": "LINK",
    },
    "threads": {"help": "Threads for the pass over the data; all cores if unset.", "min": 1},
    "seed": {"help": "Seed of the random numbers.", "min": 0},
    "verbose": {"help": "Print all errors, parameters and notes."},
    "as_json": {"name": "--json", "help": "Machine-readable results on standard output."},
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
    "measured": "COLUMN...",
    "method": "NAME",
    "motion": "MOTION",
    "payload_frame": "NAME",
    "rate": "NUMBER",
    "sensor": "NAME",
    "sensor_rest": "START:STOP...",
    "truth": "FILE",
    "unloaded": "LOG...",
    "validate": "LOG...",
    "wrench_frame": "NAME",
}
"""What stands for a value in the help text of parameters with these names."""

SHORT = {"output": ("-o",), "verbose": ("-v",)}  # short names of options


def from_function(
    home: str = "", **changes: dict[str, Any] | None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a command from a function: from its signature, bounds and docstring.

    A parameter without a default is an argument, another one an option: a switch if it is a bool
    (`--no-NAME` if the default is true), one that takes several values if it is a list. Its help
    is in the docstring of the function, its bounds are those of `checked`. The decorated function
    gets the call with these arguments as its first one. Its own further parameters are made alike;
    their help is below `Options` of its docstring, unless the type is annotated for Typer.

    Args:
        home: Module and name of a public function, such as `"steelyard:identify"`; none if empty.
            It is imported when the command is called; its help is read from the source.
        changes: What is different on the command line, by the parameter's name: `name` of the
            option, `type`, or arguments of `typer.Option`; `None` for a parameter that it lacks.
    """

    def around(body: Callable[..., None]) -> Callable[..., None]:
        def command() -> None: ...

        command.__name__ = body.__name__
        command.__doc__ = OPTIONS.sub("\n", inspect.getdoc(body) or "")
        vars(command).update(body=body, make=functools.partial(_made, body, home, changes))
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
    own = dict(inspect.signature(body).parameters)
    own_texts = argument_texts(body.__doc__)
    derived: dict[str, inspect.Parameter] = {}
    known: Mapping[str, inspect.Parameter] = {}
    if home:
        del own[next(iter(own))]
        function = declared(home)
        known = inspect.signature(function).parameters
        left_out = {"progress", *own, *(name for name, change in changes.items() if change is None)}
        options = {name for name, p in known.items() if p.default is not p.empty}
        texts = argument_texts(function.__doc__)
        texts = {name: help_text(text, options) for name, text in texts.items()}
        least = getattr(function, "least", {})
        derived = {
            name: _parameter(p, texts.get(name, ""), least.get(name), changes.get(name))
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
        first = [functools.partial(pkgutil.resolve_name(home), **arguments)] if home else []
        body(*first, **given)

    more = (_parameter(p, own_texts.get(n, ""), None, changes.get(n)) for n, p in own.items())
    parameters = [*derived.values(), *more]
    vars(run)["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return guarded(run)


def declared(home: str) -> Callable[..., Any]:
    """A function as its source declares it: what it takes, its bounds and its docstring.

    Nothing that its module imports from this package is imported, as that takes a second or two.
    """
    names, name = _Names(home.partition(":")[0]), home.partition(":")[2]
    while isinstance(node := names.defining(name), ast.ImportFrom):
        names = _Names(node.module or "")
    if not isinstance(node, ast.FunctionDef):
        raise LookupError(home)
    arguments = [*node.args.args, *node.args.kwonlyargs]
    kinds = {x.arg: eval(_compiled(x.annotation, "eval"), {}, names) for x in arguments}
    for argument in arguments:
        argument.annotation = None
    node.body, node.returns = node.body[:1], None
    exec(_compiled(node, "exec"), {}, names)
    names[name].__annotations__ = kinds
    parameters = inspect.signature(names[name]).parameters.values()
    found = inspect.Signature([p.replace(annotation=kinds[p.name]) for p in parameters])
    vars(names[name])["__signature__"] = found
    function: Callable[..., Any] = names[name]
    return function


def _compiled(node: Any, mode: str) -> Any:
    whole = ast.Module([node], []) if mode == "exec" else ast.Expression(node)
    return compile(whole, "<declaration>", mode)


def _statements(body: Sequence[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements of a module, those for type checkers included."""
    for node in body:
        yield node
        if isinstance(node, ast.If):
            yield from _statements(node.body)


class _Names(dict[str, Any]):
    """Names of a module, evaluated from its source; of classes of this package only the name."""

    def __init__(self, module: str) -> None:
        super().__init__()
        spec = find_spec(module)
        source = Path((spec and spec.origin) or "")
        stub = source.with_suffix(".pyi")
        self._tree = ast.parse((stub if stub.exists() else source).read_text(encoding="utf-8"))

    def defining(self, name: str) -> ast.AST | None:
        """The first outermost statement that defines a name."""
        for node in _statements(self._tree.body):
            match node:
                case ast.FunctionDef() | ast.ClassDef():
                    names = [node.name]
                case ast.ImportFrom():
                    names = [alias.asname or alias.name for alias in node.names]
                case ast.Assign() | ast.AnnAssign():
                    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                    inside = (x for target in targets for x in ast.walk(target))
                    names = [x.id for x in inside if isinstance(x, ast.Name)]
                case _:
                    continue
            if name in names:
                return node
        return None

    def __missing__(self, name: str) -> Any:
        match node := self.defining(name):
            case ast.ClassDef():
                self[name] = type(name, (), {})
            case ast.ImportFrom(module=str(module)):
                (original,) = (x.name for x in node.names if (x.asname or x.name) == name)
                light = not module.startswith("steelyard.") or module.startswith("steelyard.base.")
                there = vars(import_module(module)) if light else _Names(module)
                self[name] = there[original]
            case ast.Assign() | ast.AnnAssign():
                exec(_compiled(node, "exec"), {}, self)
            case _:
                raise KeyError(name)
        return self[name]


def _parameter(
    parameter: inspect.Parameter, text: str, least: float | None, changes: Mapping[str, Any] | None
) -> inspect.Parameter:
    """A parameter as Typer reads it; a switch that is on by default gets the name `no_NAME`."""
    name, default, hint = parameter.name, parameter.default, parameter.annotation
    if get_origin(hint) is Annotated:
        return parameter.replace(annotation=hint, kind=parameter.KEYWORD_ONLY)
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
        **(SHARED.get(name, {}) if changes is None else changes),
    }
    if get_origin(kind) is Literal:
        told["metavar"] = None
    kind, option = told.pop("type"), told.pop("name")
    is_argument = default is parameter.empty and "name" not in (changes or {})
    shown = (
        typer.Argument(**told)
        if is_argument
        else typer.Option(option, *SHORT.get(name, ()), **told)
    )
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


OPTIONS = re.compile(r"\n\n(?:Args|Options):\n((?: .*\n?)*)")
"""The section of a docstring that says what arguments or options are."""


def argument_texts(docstring: str | None) -> dict[str, str]:
    """What the docstring says of each argument, in one line."""
    section = OPTIONS.search(inspect.cleandoc(docstring or ""))
    found = re.findall(r"^    (\w+): (.+(?:\n {8}.+)*)", section[1] if section else "", re.M)
    return {name: " ".join(text.split()) for name, text in found}


def help_text(text: str, options: Set[str]) -> str:
    """The text of an argument for the command line, which has no `None` and no brackets."""
    text = text.replace("`None`", "unset").replace(" [s]", " in seconds")
    text = re.sub(r" \[([^]]+)\]", lambda unit: f" in {unit[1].replace('; ', ' or ')}", text)
    return re.sub(r"`([^ `]+)`", lambda m: _option(m[1]) if m[1] in options else m[1], text)


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")

"""TOML text checked against its schema: lines of the keys, messages, the base of all sections."""

import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from steelyard.base.errors import ModelError, advice

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["tomllib"]

Item = TypeVar("Item")
Many = Annotated[tuple[Item, ...], Field(strict=False)]  # any number of items of one kind
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Name = Annotated[str, Field(min_length=1)]
Pair = Annotated[tuple[Name, Name], Field(strict=False)]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Names = Many[Name]
Numbers = Many[float]

ADVICE = "advice"
"""Type of an error of a check whose message is the whole advice."""


class Section(BaseModel):
    """A table of the robot file: no unknown keys, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


def meanings_of(section: type[Section]) -> dict[str, str]:
    """Key to meaning: the `description` of its field, or its entry under `Attributes`."""
    found: dict[str, str] = {}
    for one in (base for base in reversed(section.__mro__) if issubclass(base, Section)):
        entries = re.findall(r"^    (\w+): (.+(?:\n {8}.+)*)", inspect.getdoc(one) or "", re.M)
        found |= {name: " ".join(meaning.split()) for name, meaning in entries}
        found |= {name: f.description for name, f in one.model_fields.items() if f.description}
    return found


def key(default: Any, meaning: str) -> Any:
    """A key of a section: its default, `...` for a required one, and its meaning."""
    return Field(default, description=meaning)


KeyPath = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}' r"|'''.*?'{3,5}" r'|"(?:\\.|[^"\\\n])*"' r"|'[^'\n]*'", re.S
)
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\n]+")


class TomlPlaces:
    """Where keys are in a text that `tomllib` has accepted.

    `lines` has the line, from 1, of every key and item: `("robot", "dh", "links", 0, "alpha")`;
    `ends`, by table, where its last key or its header ends, and below which header that is.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[KeyPath, int] = {}
        self.counts: dict[KeyPath, int] = {}
        self.ends: dict[KeyPath, tuple[int, KeyPath]] = {}
        table: KeyPath = ()
        self.skip(_BLANK)
        while self.at < len(self.text):
            header = self.text[self.at] == "["
            if header:
                table = self.header()
            inside = table if header else self.pair(table)[:-1]
            self.ends[inside] = self.at, table
            self.skip(_BLANK)

    def skip(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        found = match.group() if match else ""
        self.at += len(found)
        return found

    def note(self, path: KeyPath, at: int) -> None:
        """The path and every table above it are on the line of an offset, unless seen before."""
        line = self.text.count("\n", 0, at) + 1
        for end in range(1, len(path) + 1):
            self.lines.setdefault(path[:end], line)

    def header(self) -> KeyPath:
        start, several = self.at, self.text.startswith("[[", self.at)
        self.at += 1 + several
        *above, last = self.key()
        path: KeyPath = ()
        for part in above:
            path = (*path, part)
            if path in self.counts:
                path = (*path, self.counts[path] - 1)
        path = (*path, last)
        if several:
            self.counts[path] = self.counts.get(path, 0) + 1
            path = (*path, self.counts[path] - 1)
        self.note(path, start)
        self.at += 1 + several
        return path

    def key(self) -> list[str]:
        parts = []
        while True:
            self.skip(_SPACE)
            quoted = self.skip(_STRING)
            parts.append(quoted[1:-1] if quoted else self.skip(_BARE))
            self.skip(_SPACE)
            if not self.text.startswith(".", self.at):
                return parts
            self.at += 1

    def pair(self, table: KeyPath) -> KeyPath:
        start = self.at
        path = (*table, *self.key())
        self.note(path, start)
        self.at += 1  # the equals sign
        self.skip(_SPACE)
        self.value(path)
        return path

    def value(self, path: KeyPath) -> None:
        opening = self.text[self.at]
        if opening in "[{":
            self.items(path, "]" if opening == "[" else "}")
        else:
            self.skip(_STRING if opening in "\"'" else _SCALAR)

    def items(self, path: KeyPath, closing: str) -> None:
        self.at += 1
        index = 0
        self.skip(_BLANK)
        while self.text[self.at] != closing:
            if closing == "}":
                self.pair(path)
            else:
                self.note((*path, index), self.at)
                self.value((*path, index))
            index += 1
            self.skip(_BLANK)
            if self.text[self.at] == ",":
                self.at += 1
                self.skip(_BLANK)
        self.at += 1


Schema = TypeVar("Schema", bound=BaseModel)


def place_of(path: Path, lines: Mapping[KeyPath, int], *key: str | int) -> str:
    """File, line and key, for messages; the nearest table above if the key is not given."""
    given: KeyPath = key
    while given and given not in lines:
        given = given[:-1]
    line = f", line {lines[given]}" if given else ""
    return f"{path}{line}" + (f", {shown(key)}" if key else "")


def shown(key: KeyPath) -> str:
    """A key path as users write it: `[signals.effort] gain`, `[model] terms[2]`."""
    names: list[str] = []
    for part in key:
        if isinstance(part, str):
            names.append(part)
        else:
            names[-1] += f"[{part + 1}]"
    table = ".".join(names[:-1])
    return f"[{table}] {names[-1]}" if table else f"[{names[0]}]"


def checked(path: Path, text: str, schema: type[Schema]) -> tuple[Schema, Callable[..., str]]:
    """The text as a value of the schema, and where its keys are."""
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        why = "brackets are nested too deeply" if isinstance(error, RecursionError) else error
        raise ModelError(
            f"the robot file is not valid TOML: {why}",
            where=str(path),
            fix="correct that line, or a bracket or quote left open above it: text in quotes, "
            "lists in [ ], each key once",
        ) from None
    locate = partial(place_of, path, TomlPlaces(text).lines)
    if (path_of_nan := next(_not_numbers(data), None)) is not None:
        raise ModelError(
            f"'{path_of_nan[-1]}' is nan, which is no number",
            where=locate(*path_of_nan),
            fix="write a number, or leave the key out",
        )
    try:
        return schema.model_validate(data), locate
    except ValidationError as error:
        raise _explained(error, data, schema, locate) from None


def _not_numbers(data: Any, path: KeyPath = ()) -> Iterator[KeyPath]:
    """Where values are nan: also in tables whose keys are checked later, by their kind."""
    if isinstance(data, float) and data != data:
        yield path
    if isinstance(data, dict | list):
        for name, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _not_numbers(value, (*path, name))


def _explained(
    error: ValidationError, data: Any, schema: type[BaseModel], locate: Callable[..., str]
) -> ModelError:
    flaws = error.errors(include_url=False)
    first = min(flaws, key=lambda f: (f["type"] != "extra_forbidden", -len(_path(data, f["loc"]))))
    path = place = _path(data, first["loc"])
    name, last = path[-1] if path else "the file", first["loc"][-1]
    if first["type"] == "extra_forbidden":
        wrong = f"unknown key '{name}'"
        fix = advice(str(name), _known_keys(schema, path[:-1], data), "keys there")
    elif first["type"] == "union_tag_invalid":
        kind, kinds = first["ctx"]["tag"], first["ctx"]["expected_tags"].split(",")
        wrong, place = f"there is no kind '{kind}' of '{name}'", (*path, "kind")
        fix = advice(str(kind), [one.strip("' ") for one in kinds], "kinds")
    elif first["type"] == "missing" and isinstance(last, int):
        same = [flaw["loc"][-1] for flaw in flaws if flaw["loc"][:-1] == first["loc"][:-1]]
        wrong = f"the list '{name}' is too short"
        fix = f"give it {1 + max(k for k in same if isinstance(k, int))} entries"
    elif first["type"] == "missing":
        wrong = f"key '{last}' is missing"
        fix = f"add {last} = ... to {shown(path)}" if path else f"add a [{last}] table"
    else:
        table = "valid dictionary( or (instance of|object to) .+)?"
        words = dict.fromkeys(
            re.sub(table, "table", flaw["msg"])
            .replace("Input should be", "")
            .replace("tuple", "list in [ ]")
            .strip()
            for flaw in flaws
            if _path(data, flaw["loc"]) == path
        )
        wrong = f"{first['input']!r} cannot be used for '{name}'"
        fix = first["msg"] if first["type"] == ADVICE else "it should be " + ", or ".join(words)
    return ModelError(wrong, where=locate(*place), fix=fix)


def _path(data: Any, loc: tuple[str | int, ...]) -> KeyPath:
    """The part of pydantic's location that is in the data: without names of union members."""
    path: list[str | int] = []
    for part in loc:
        inside = isinstance(data, dict) and part in data
        if inside or (isinstance(data, list) and isinstance(part, int) and part < len(data)):
            path.append(part)
            data = data[part]
    return tuple(path)


def _known_keys(schema: type[BaseModel], path: KeyPath, data: Any) -> list[str]:
    for part in path:
        data = data[part]
        field = schema.model_fields.get(str(part))
        inner = list(_schemas(field.annotation)) if field else [schema]
        said = data.get("kind") if isinstance(data, dict) else None
        tagged = [one for one in inner if "kind" in one.model_fields]
        fitting = [x for x in tagged if said in get_args(x.model_fields["kind"].annotation)]
        schema = (fitting or inner or [schema])[0]
    return list(schema.model_fields)


def _schemas(annotation: Any) -> Iterator[type[BaseModel]]:
    """The pydantic models inside a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _schemas(argument)


def as_declared(declared: Any, value: Any) -> Any:
    """A value as a type says it, strictly; a `ValueError` says which type is wanted."""
    strict = ConfigDict(strict=True, allow_inf_nan=False)
    try:
        return TypeAdapter(declared, config=strict).validate_python(value)
    except ValidationError as error:
        raise ValueError(error.errors()[0]["msg"].lower()) from None

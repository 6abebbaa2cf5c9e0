"""A TOML text checked against its schema; messages name the line and the nearest key."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from steelyard.errors import ModelError
from steelyard.robot_file.section import ADVICE
from steelyard.robot_file.toml_lines import KeyPath, toml_lines
from steelyard.robot_file.toml_reader import tomllib
from steelyard.suggest import advice

Schema = TypeVar("Schema", bound=BaseModel)


class Places:
    """Where the keys of one TOML file are."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self._lines = toml_lines(text)

    def where(self, *key: str | int) -> str:
        """File, line and key, for messages; the nearest table above if the key is not given."""
        given: KeyPath = key
        while given and given not in self._lines:
            given = given[:-1]
        line = f", line {self._lines[given]}" if given else ""
        return f"{self.path}{line}" + (f", {shown(key)}" if key else "")


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


def checked(path: Path, text: str, schema: type[Schema]) -> tuple[Schema, Places]:
    """The text as a value of the schema, and where its keys are.

    Raises:
        ModelError: The text is not TOML, or a key is unknown, missing or of the wrong type.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ModelError(
            f"the robot file is not valid TOML: {error}",
            where=str(path),
            fix="correct that line, or a bracket or quote left open above it: text in quotes, "
            "lists in [ ], each key once",
        ) from None
    places = Places(path, text)
    try:
        return schema.model_validate(data), places
    except ValidationError as error:
        raise _explained(error, data, schema, places) from None


def _explained(
    error: ValidationError, data: Any, schema: type[BaseModel], places: Places
) -> ModelError:
    """The first flaw, in the users' words."""
    flaws = error.errors(include_url=False)
    first = min(flaws, key=lambda f: (f["type"] != "extra_forbidden", -len(_path(data, f["loc"]))))
    path = _path(data, first["loc"])
    if first["type"] == "extra_forbidden":
        known = _known_keys(schema, path[:-1], data)
        return ModelError(
            f"unknown key '{path[-1]}'",
            where=places.where(*path),
            fix=advice(str(path[-1]), known, "keys there"),
        )
    if first["type"] == "union_tag_invalid":
        kind, kinds = first["ctx"]["tag"], first["ctx"]["expected_tags"]
        return ModelError(
            f"there is no kind '{kind}' of '{path[-1]}'",
            where=places.where(*path, "kind"),
            fix=advice(str(kind), [one.strip("' ") for one in kinds.split(",")], "kinds"),
        )
    last = first["loc"][-1]
    if first["type"] == "missing" and isinstance(last, int):
        same = [flaw["loc"][-1] for flaw in flaws if flaw["loc"][:-1] == first["loc"][:-1]]
        return ModelError(
            f"the list '{path[-1]}' is too short",
            where=places.where(*path),
            fix=f"give it {1 + max(k for k in same if isinstance(k, int))} entries",
        )
    if first["type"] == "missing":
        missing = str(last)
        return ModelError(
            f"key '{missing}' is missing",
            where=places.where(*path),
            fix=f"add {missing} = ... to {shown(path)}" if path else f"add a [{missing}] table",
        )
    words = dict.fromkeys(
        _wanted(flaw["msg"]) for flaw in flaws if _path(data, flaw["loc"]) == path
    )
    return ModelError(
        f"{first['input']!r} cannot be used for '{path[-1] if path else 'the file'}'",
        where=places.where(*path),
        fix=first["msg"] if first["type"] == ADVICE else "it should be " + ", or ".join(words),
    )


def _wanted(message: str) -> str:
    """What pydantic asks for, in the words of TOML."""
    message = re.sub("valid dictionary( or (instance of|object to) .+)?", "table", message)
    return message.replace("Input should be", "").replace("tuple", "list in [ ]").strip()


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
    """Keys that the table at `path` may have."""
    for part in path:
        data = data[part]
        field = schema.model_fields.get(str(part))
        inner = list(_schemas(field.annotation)) if field else []
        schema = next((one for one in inner if _is_of(one, data)), inner[0] if inner else schema)
    return list(schema.model_fields)


def _is_of(schema: type[BaseModel], table: Any) -> bool:
    """Whether a table says that it is of a schema's kind."""
    kind = schema.model_fields.get("kind")
    return (
        kind is not None
        and isinstance(table, dict)
        and table.get("kind") in get_args(kind.annotation)
    )


def _schemas(annotation: Any) -> Iterator[type[BaseModel]]:
    """The pydantic models inside a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _schemas(argument)

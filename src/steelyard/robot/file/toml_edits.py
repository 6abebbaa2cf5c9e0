"""Keys of a robot file set and removed; values, keys and comments written as TOML."""

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from steelyard.base.arrays import json_values
from steelyard.base.errors import ModelError
from steelyard.robot.file.toml_schema import TomlPlaces, shown


def toml_text(value: Any) -> str:
    """A value in TOML."""
    if isinstance(value, tuple | list):
        return "[" + ", ".join(toml_text(v) for v in value) + "]"
    return _value(value if isinstance(value, str) else float(value))


def comment(text: str, start: str = "# ") -> str:
    """The text as comment lines, whatever characters are in it."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    again = start[: len(start) - len(start.lstrip())] + "#   "
    return textwrap.fill(printable, 98, initial_indent=start, subsequent_indent=again)


def toml_key(name: str) -> str:
    """A key in TOML, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_text(name)


@dataclass(frozen=True)
class Edit:
    """One key of the robot file and its new value."""

    path: tuple[str, ...]  # tables and key, such as `("signals", "effort", "unit")`
    value: Any  # a TOML value; `None` takes the key out
    # relative standard deviation of the numbers where they are fitted factors, else 0
    spread: float = field(default=0.0, compare=False)


def edited(text: str, changes: Sequence[Edit]) -> str:
    """A text with keys changed; a new one goes behind the last of its table, or the text."""
    for change in changes:
        text = _changed(text, change.path, json_values(change.value))
    return text


def lines_of(changes: Sequence[Edit]) -> str:
    """The changes as lines of a robot file, by table; a key that goes is a comment."""
    tables: dict[tuple[str, ...], list[str]] = {}
    for change in changes:
        name, value = toml_key(change.path[-1]), json_values(change.value)
        line = f"# remove {name}" if value is None else f"{name} = {_value(value)}"
        tables.setdefault(change.path[:-1], []).append(line)
    return "\n\n".join("\n".join([_header(path), *lines]) for path, lines in tables.items())


def _changed(text: str, path: tuple[str, ...], value: Any) -> str:
    import tomlkit
    from tomlkit.exceptions import TOMLKitError
    from tomlkit.items import InlineTable

    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise _unfit(f"the text is not TOML: {error}", path) from None
    above: Any = document
    table: Any = document
    for depth, name in enumerate(path):
        if not isinstance(table, Mapping):
            raise _unfit(f"'{shown(path[:depth])}' is no table", path)
        if isinstance(table, InlineTable):
            return _changed(text, path[:depth], _set(table.unwrap(), path[depth:], value))
        if name not in table:
            return (
                text if value is None else _added(text, path[: depth + 1], path[depth + 1 :], value)
            )
        above, table = table, table[name]
    if value is None:
        del above[path[-1]]
    else:
        above[path[-1]] = _item(value)
    return tomlkit.dumps(document)


def _set(table: dict[str, Any], path: Sequence[str], value: Any) -> dict[str, Any]:
    name, *inside = path
    inner = table.get(name)
    if inside:
        if value is None and inner is None:
            return table
        if not isinstance(inner, dict | None):
            raise _unfit(f"'{name}' is no table", (*path,))
        value = _set(inner or {}, inside, value)
    return {k: v for k, v in {**table, name: value}.items() if v is not None}


def _added(text: str, path: tuple[str, ...], inside: Sequence[str], value: Any) -> str:
    """The text with a key at `path`, whose tables are there; `inside` it are tables of its own."""
    ends, above = TomlPlaces(text).ends, path[:-1]
    if inside and (not above or above not in ends):  # the innermost of them gets a head
        path, value, inside = (*path, *inside[:-1]), {inside[-1]: value}, ()
    for name in reversed(inside):
        value = {name: value}
    if isinstance(value, Mapping) and (not above or above not in ends):
        lines = [f"{toml_key(name)} = {_value(inner)}" for name, inner in value.items()]
        return "\n".join([f"{text.rstrip()}\n\n{_header(path)}", *lines]).lstrip() + "\n"
    if above not in ends:
        line = f"{toml_key(path[-1])} = {_value(value)}\n"
        return f"{text.rstrip()}\n\n{_header(above)}\n{line}" if above else f"{line}{text}"
    last, table = ends[above]
    name = ".".join(toml_key(part) for part in path[len(table) :])
    end = text.find("\n", last)
    end = len(text) if end < 0 else end
    return f"{text[:end]}\n{name} = {_value(value)}{text[end:]}"


def _unfit(wrong: str, path: tuple[str, ...]) -> ModelError:
    return ModelError(wrong, where=f"robot file, {shown(path)}", fix="change it by hand")


def _header(path: Sequence[str]) -> str:
    return f"[{'.'.join(toml_key(name) for name in path)}]"


def _value(value: Any) -> str:
    if isinstance(value, list) and any(isinstance(one, Mapping) for one in value):
        return "[" + ", ".join(_value(one) for one in value) + "]"  # tables, in line
    return str(_item(value).as_string())


def _item(value: Any) -> Any:
    """A value of tomlkit's; a table is one in line, also in a list."""
    import tomlkit

    if isinstance(value, list | tuple):
        items = tomlkit.array()
        for inner in value:
            items.append(_item(inner))
        return items
    if not isinstance(value, Mapping):
        return tomlkit.item(value)
    table = tomlkit.inline_table()
    for name, inner in value.items():
        table[name] = _item(inner)
    return table

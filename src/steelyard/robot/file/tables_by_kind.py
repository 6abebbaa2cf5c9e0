"""Values that a table describes by the name of their kind and its fields."""

import dataclasses
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, dataclass
from typing import Any, get_type_hints

from steelyard.base.errors import ModelError, advice, refuse_unknown


@dataclass(frozen=True)
class Kinds:
    """All kinds that a table may be of: dataclasses by the name under a key of the table.

    For messages, `what` a kind is, such as `method for motion`, and the `label` before its name:
    `method`.
    """

    register: Mapping[str, type[Any]]
    key: str
    what: str
    label: str

    def fields(
        self, given: str | Mapping[str, Any], where: str
    ) -> tuple[type[Any], dict[str, Any]]:
        """The dataclass that a name, or a table with it, is of, and its fields as they stand."""
        table = {self.key: given} if isinstance(given, str) else dict(given)
        name = table.pop(self.key, None)
        if not isinstance(name, str) or name not in self.register:
            none = f"the table does not name its {self.key}"
            raise ModelError(
                none if name is None else f"'{name}' is no {self.what}",
                where=where,
                fix=advice(str(name or ""), self.register, f"{self.key}s", len(self.register)),
            )
        kind = self.register[name]
        known = [field.name for field in dataclasses.fields(kind)]
        for key in table:
            wrong = f"{self.label} '{name}' does not understand '{key}'"
            refuse_unknown(key, known, wrong, where, "keys there")
        for field in dataclasses.fields(kind):
            if field.name not in table and field.default is field.default_factory is MISSING:
                raise ModelError(
                    f"{self.label} '{name}' needs '{field.name}'",
                    where=where,
                    fix=f"add {field.name} = ... to it",
                )
        return kind, table

    def built(self, given: str | Mapping[str, Any], where: str) -> Any:
        """The value, its fields of the types that the dataclass declares."""
        kind, table = self.fields(given, where)
        hints = get_type_hints(kind)
        with at_place(where):
            return kind(**{key: _value(hints[key], key, x, where) for key, x in table.items()})


@contextmanager
def at_place(where: str) -> Iterator[None]:
    """Errors inside say that they are about a place in a file."""
    try:
        yield
    except ModelError as error:
        raise ModelError(error.wrong, where=where, fix=error.fix) from None


def _value(declared: Any, name: str, value: Any, where: str) -> Any:
    from steelyard.robot.file.toml_schema import as_declared

    try:
        return as_declared(declared, _tuples(value))
    except ValueError as error:
        raise ModelError(
            f"{value!r} cannot be used for '{name}'",
            where=where,
            fix=str(error)
            .replace("input", "it")
            .replace("tuple", "list in [ ]")
            .replace("field required", "give three numbers, [x, y, z]"),
        ) from None


def _tuples(value: Any) -> Any:
    return tuple(_tuples(x) for x in value) if isinstance(value, list) else value

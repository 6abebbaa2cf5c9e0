"""Read-only arrays, and parameters that carry their names and units."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import partial
from math import isfinite
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Key = TypeVar("Key")
Value = TypeVar("Value")
Made = TypeVar("Made")

Z95 = 1.959963984540054  # half-width of a 95 % interval in standard deviations


def frozen(values: ArrayLike, shape: Sequence[int | None] | None = None) -> Array:
    """A read-only float64 copy; a `ValueError` if the shape is another, `None` entries free."""
    array = np.array(values, dtype=np.float64, order="C")
    if shape is not None and (
        array.ndim != len(shape)
        or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True))
    ):
        wanted = " x ".join("any" if n is None else str(n) for n in shape)
        raise ValueError(f"expected an array of {wanted} numbers, got shape {array.shape}")
    array.flags.writeable = False
    return array


def records(**columns: Iterable[Any]) -> list[dict[str, Any]]:
    """Rows of equally long columns by name, numbers of arrays as those of Python."""
    values = [x.tolist() if isinstance(x, np.ndarray) else x for x in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*values, strict=True)]


def stretches(marks: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First place and the one after the last of all stretches that are marked."""
    edges = np.flatnonzero(np.diff(marks, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def places_of(names: Iterable[Key], among: Iterable[Key]) -> list[int]:
    """Where names stand among others, all of which must be there."""
    place = {name: k for k, name in enumerate(among)}
    return [place[name] for name in names]


def by_key(pairs: Iterable[tuple[Key, Value]]) -> dict[Key, list[Value]]:
    """The second values of pairs by the first ones, both in the order in which they come."""
    found: dict[Key, list[Value]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


def distinct_texts(names: Iterable[str], longest: int | None = None) -> list[str]:
    """Names, no two alike and none longer than the `longest`: later ones get a number."""
    found: list[str] = []
    for name in names:
        own, number = name[:longest], 1
        while own in found:
            number += 1
            end = f"_{number}"
            own = f"{name[: longest and longest - len(end)]}{end}"
        found.append(own)
    return found


def set_fields(value: object, **contents: object) -> None:
    """Set fields of a frozen dataclass, for its `__post_init__`."""
    for name, content in contents.items():
        object.__setattr__(value, name, content)


def json_values(value: Any, *, finite: bool = False) -> Any:
    """As JSON values; exact. Of a dataclass its fields, those of its `parameters` among them.

    `finite`: `None` takes the place of numbers that are not.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, tuple | list):
        return [json_values(x, finite=finite) for x in value]
    if isinstance(value, Mapping):
        return {name: json_values(x, finite=finite) for name, x in value.items()}
    if not is_dataclass(value):
        return None if finite and isinstance(value, float) and not isfinite(value) else value
    found: dict[str, Any] = {}
    for name in (field.name for field in fields(value)):
        content = json_values(getattr(value, name), finite=finite)
        found |= content if name == "parameters" else {name: content}
    return found


finite_json = partial(json_values, finite=True)


def of_json_values(kind: type[Made], values: Mapping[str, Any]) -> Made:
    """The dataclass that `json_values` wrote; what is missing has its default, if it has one."""
    hints, given = get_type_hints(kind), dict[str, Any]()
    for field in fields(kind):  # type: ignore[arg-type]
        if field.name == "parameters":
            given["parameters"] = Parameters(values["names"], values["units"], values["values"])
        elif field.name in values or field.default is field.default_factory is MISSING:
            given[field.name] = _of_json(hints[field.name], values[field.name])
    return kind(**given)


def _of_json(hint: Any, value: Any) -> Any:
    """A value of a field's type."""
    if get_origin(hint) is UnionType:
        if value is None:
            return None
        (hint,) = (one for one in get_args(hint) if one is not NoneType)
    if is_dataclass(hint):
        return of_json_values(hint, value)  # type: ignore[arg-type]
    if get_origin(hint) is np.ndarray:
        return frozen(value)
    if get_origin(hint) is tuple and get_args(hint)[1:] == (Ellipsis,):
        return tuple(_of_json(get_args(hint)[0], one) for one in value)
    return value


@dataclass(frozen=True)
class Parameter:
    """One parameter of a model: name, unit, physical bounds, and the prior value if known."""

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    prior: float | None = None


@dataclass(frozen=True, eq=False)
class Parameters:
    """Values `(p,)`, read-only, of named parameters with their units; names are unique."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array

    def __init__(self, names: Sequence[str], units: Sequence[str], values: ArrayLike) -> None:
        set_fields(self, names=tuple(names), units=tuple(units))
        set_fields(self, values=frozen(values, (len(self.names),)))
        if len(self.units) != len(self.names):
            raise ValueError(f"{len(self.names)} names but {len(self.units)} units")
        if len(set(self.names)) != len(self.names):
            twice = next(n for n in self.names if self.names.count(n) > 1)
            raise ValueError(f"parameter name '{twice}' is given twice")

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __getitem__(self, name: str) -> float:
        try:
            return float(self.values[self.names.index(name)])
        except ValueError:
            raise KeyError(name) from None

    def of(self, places: Sequence[int]) -> "Parameters":
        """Some of the parameters, by their places."""
        names, units = ([some[k] for k in places] for some in (self.names, self.units))
        return Parameters(names, units, self.values[list(places)])

    def named(self, names: Iterable[str]) -> Array:
        """Values by name, zero of those that are not here, shape `(k,)`."""
        known = self.as_dict()
        return np.array([known.get(name, 0.0) for name in names])

    def as_dict(self) -> dict[str, float]:
        """Name to value."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

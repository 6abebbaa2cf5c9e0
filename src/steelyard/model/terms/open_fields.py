"""Fields whose values are still to be found from data."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from steelyard.base.errors import ModelError

FIND = "find"
"""The word in robot files: `speed = "find"` or `speed = {find = [0.001, 1.0]}`."""


@dataclass(frozen=True)
class Find:
    """Stands in a field of a term until its value is found between two bounds above zero.

    If `shared`, all coordinates of the term have one value.
    """

    lower: float
    upper: float
    shared: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.lower < self.upper < float("inf"):
            raise ModelError(
                f"a nonlinear parameter is to be estimated between {self.lower} and {self.upper}",
                where="list of terms",
                fix="give two numbers above zero, the smaller one first: {find = [0.001, 1.0]}",
            )

    @property
    def description(self) -> dict[str, Any]:
        """The table of a robot file."""
        return {FIND: [self.lower, self.upper], "per_joint": not self.shared}


def is_search(given: Any) -> bool:
    """Whether a value of a file, or a part of it, requests a search."""
    if isinstance(given, list | tuple):
        return any(is_search(x) for x in given)
    if isinstance(given, Mapping):
        return FIND in given and not isinstance(given[FIND], Mapping)
    return bool(given == FIND)


def search_of(law: type[Any], field: str, given: Any, where: str) -> Find:
    """The search that a value of a file requests for a law's field.

    `given` is `"find"`, or a table with `find` (bounds, or `true` for the law's own) and, if there
    is to be one value per joint, `per_joint = true`.
    """
    default = searchable(law, field, where)
    table = {FIND: True} if given == FIND else given
    strange = not isinstance(table, Mapping) or not set(table) <= {FIND, "per_joint"}
    bounds = None if strange else table[FIND]
    bounds = default if bounds is True else bounds
    per_joint = False if strange else table.get("per_joint", False)
    if (
        not isinstance(bounds, list | tuple)
        or len(bounds) != 2
        or not all(isinstance(x, float | int) and not isinstance(x, bool) for x in bounds)
        or not isinstance(per_joint, bool)
    ):
        raise ModelError(
            f"term '{law.law}' has {field} = {given!r}",
            where=where,
            fix=f'write {field} = "find", or '
            f"{field} = {{find = [{default[0]:g}, {default[1]:g}], per_joint = true}}; "
            "for numbers on some joints only, give each its own term (see `joints`)",
        )
    return Find(float(bounds[0]), float(bounds[1]), not per_joint)


def searchable(law: type[Any], field: str, where: str) -> tuple[float, float]:
    """The law's own bounds of a field; `ModelError` if it cannot be found."""
    bounds: Mapping[str, tuple[float, float]] = law.bounds
    if field not in bounds:
        others = " and ".join(f"'{name}'" for name in bounds) or "none of its keys"
        raise ModelError(
            f"the key '{field}' of term '{law.law}' cannot be estimated from data",
            where=where,
            fix=f"give '{field}' a value; {others} can be estimated",
        )
    return bounds[field]


def finds_of(term: Any) -> dict[str, Find]:
    """The fields of a term that are to be found, by name."""
    given = {f.name: getattr(term, f.name) for f in fields(term)}
    found = {name: value for name, value in given.items() if isinstance(value, Find)}
    for name in found:
        searchable(type(term), name, "list of terms")
    return found

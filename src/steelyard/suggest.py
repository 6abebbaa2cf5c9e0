"""Help for misspelt names."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

_ALIKE = 0.2
"""Least similarity of names that are listed before the others."""


def nearest(name: str, names: Iterable[str], count: int = 3) -> tuple[str, ...]:
    """Up to `count` of `names` that look like `name`, the nearest first; letter case aside.

    Where none does, those that are its end, or it theirs: `q_0` of `actual_q_0`.
    """
    known = list(names)
    ends = [one for one in known if _ends(name.lower(), one.lower())]
    return _ordered(name, known, count, 0.5) or _ordered(name, ends, count, 0.0)


def advice(name: str, names: Iterable[str], what: str, most: int = 12) -> str:
    """One line that offers the nearest of `names`, or all of them when none is near.

    Args:
        name: The name that was not found.
        names: Those that exist.
        what: What they are, in the plural: `joints`, `keys`.
        most: How many are listed at most.
    """
    known = list(names)
    if near := nearest(name, known):
        return "did you mean " + " or ".join(f"'{n}'" for n in near) + "?"
    return listing(known, what, most, like=name)


def listing(names: Iterable[str], what: str, most: int = 12, like: str = "") -> str:
    """One line that lists the names, `most` of them at most: then those most similar to `like`."""
    known = list(names)
    if like and len(known) > most:
        known = [*dict.fromkeys([*_ordered(like, known, most, _ALIKE), *known])]
    if not known:
        return f"there are no {what} to choose from"
    shown = ", ".join(known[:most])
    shown += f", and {len(known) - most} more" if len(known) > most else ""
    return f"the {what} are {shown}"


def _ordered(name: str, names: Iterable[str], count: int, least: float) -> tuple[str, ...]:
    """Up to `count` of the names, the most similar first, whose similarity is `least` or more."""
    by_lower = {known.lower(): known for known in names}
    return tuple(by_lower[n] for n in get_close_matches(name.lower(), by_lower, count, least))


def _ends(one: str, other: str) -> bool:
    """Whether one name ends in the other behind a separator."""
    longer, shorter = sorted((one, other), key=len, reverse=True)
    return bool(shorter) and longer.endswith(tuple(f"{mark}{shorter}" for mark in "_./- "))


def names_beside(path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names beside a missing file: those that look like its own, and those of the same kind."""
    if not path.parent.is_dir():
        return (), ()
    names = sorted(one.name for one in path.parent.iterdir() if not one.name.startswith("."))
    alike = tuple(name for name in names if Path(name).suffix.lower() == path.suffix.lower())
    return nearest(path.name, names), alike

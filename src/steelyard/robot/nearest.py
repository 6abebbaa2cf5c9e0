"""Help for misspelt names."""

from collections.abc import Iterable
from difflib import get_close_matches


def nearest(name: str, names: Iterable[str], count: int = 3) -> tuple[str, ...]:
    """Up to `count` of `names` that look like `name`, the nearest first; letter case aside."""
    by_lower = {known.lower(): known for known in names}
    return tuple(by_lower[n] for n in get_close_matches(name.lower(), by_lower, count, 0.5))


def advice(name: str, names: Iterable[str], what: str) -> str:
    """One line that offers the nearest of `names`, or all of them when none is near.

    Args:
        name: The name that was not found.
        names: Those that exist.
        what: What they are, in the plural: `joints`, `keys`.
    """
    known = list(names)
    if near := nearest(name, known):
        return "did you mean " + " or ".join(f"'{n}'" for n in near) + "?"
    return listing(known, what)


def listing(names: Iterable[str], what: str) -> str:
    """One line that lists the names, a dozen at most."""
    known = list(names)
    if not known:
        return f"there are no {what} to choose from"
    shown = ", ".join(known[:12]) + (f", and {len(known) - 12} more" if len(known) > 12 else "")
    return f"the {what} are {shown}"

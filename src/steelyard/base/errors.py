"""The one error root with its fix lines, text of strangers, misspelt names, optional packages."""

import unicodedata
from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

UNPRINTABLE = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories that move the cursor, turn the direction of writing or cannot be encoded."""


def visible(text: str, keep: str = "") -> str:
    r"""The text with control characters, those in `keep` apart, written as Python escapes them.

    A terminal would obey them: an escape sequence or a line feed in a column's name can print a
    line that looks like the program's own.

    Example:
        >>> print(visible("q1\x1b[1A"))
        q1\x1b[1A
    """
    if text.isprintable():
        return text
    return "".join(
        letter.encode("unicode_escape").decode("ascii")
        if letter not in keep and unicodedata.category(letter) in UNPRINTABLE
        else letter
        for letter in text
    )


Named = TypeVar("Named")


class SteelyardError(Exception):
    """Something a user gave cannot be used.

    Args:
        wrong: What is wrong, in one sentence.
        where: The file, line, column or joint it is wrong in.
        fix: What the user can do about it.

    Example:
        >>> try:
        ...     load_robot("missing.urdf")
        ... except SteelyardError as error:
        ...     print(error.where)
        missing.urdf
    """

    def __init__(self, wrong: str, *, where: str, fix: str) -> None:
        super().__init__(wrong, where, fix)
        self.wrong = visible(wrong)
        self.where = visible(where)
        self.fix = visible(fix, "\n")

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), where=self.where, fix=self.fix), (self.wrong,)

    def __str__(self) -> str:
        return f"{self.wrong}\n  where  {self.where}\n  fix    {self.fix}"


class ModelError(SteelyardError):
    """A robot model or robot file cannot be used."""


class OpenModelError(ModelError):
    """A model file leaves open what a robot file has to say; `fix` states the key."""


class LogError(SteelyardError):
    """A recording cannot be used."""


class DataError(SteelyardError):
    """The data do not allow what was requested of them."""


class OutputError(SteelyardError):
    """A result cannot be written."""


class PackageError(SteelyardError):
    """An optional package is not installed; `fix` is the line that installs it."""


_LEAST_SIMILARITY = 0.2  # least similarity of names that are listed before the others


def nearest(name: str, names: Iterable[str], count: int = 3) -> tuple[str, ...]:
    """Up to `count` of `names` like `name`, or else with the end of it: `q_0`, `actual_q_0`."""
    known, ends = list(names), []
    for one in known:
        longer, shorter = sorted((name.lower(), one.lower()), key=len, reverse=True)
        if shorter and longer.endswith(tuple(f"{mark}{shorter}" for mark in "_./- ")):
            ends.append(one)
    return _names_by_similarity(name, known, count, 0.5) or _names_by_similarity(
        name, ends, count, 0.0
    )


def advice(name: str, names: Iterable[str], what: str, most: int = 12) -> str:
    """One line that offers the nearest of `names`, or lists `most` of them when none is near."""
    known = list(names)
    if near := nearest(name, known):
        return "did you mean " + " or ".join(f"'{n}'" for n in near) + "?"
    return listing(known, what, most, like=name)


def named(name: str, known: Mapping[str, Named], what: str, plural: str, where: str) -> Named:
    """The one of a name; a `ModelError` lists the others if there is none."""
    refuse_unknown(name, known, f"there is no {what} '{name}'", where, plural)
    return known[name]


def refuse_unknown(
    name: str,
    known: Collection[str],
    wrong: str,
    where: str,
    what: str,
    error: type[SteelyardError] = ModelError,
) -> None:
    """Refuse a name that is not known, and offer those that are, which are `what`."""
    if name not in known:
        raise error(wrong, where=where, fix=advice(name, known, what))


def listing(names: Iterable[str], what: str, most: int = 12, like: str = "") -> str:
    """One line that lists the names, `most` of them at most: then those most similar to `like`."""
    known = list(names)
    if like and len(known) > most:
        known = [
            *dict.fromkeys([*_names_by_similarity(like, known, most, _LEAST_SIMILARITY), *known])
        ]
    if not known:
        return f"there are no {what} to choose from"
    shown = ", ".join(known[:most])
    shown += f", and {len(known) - most} more" if len(known) > most else ""
    return f"the {what} are {shown}"


def _names_by_similarity(
    name: str, names: Iterable[str], count: int, least: float
) -> tuple[str, ...]:
    """Up to `count` of the names, the most similar first, whose similarity is `least` or more."""
    by_lower = {known.lower(): known for known in names}
    return tuple(by_lower[n] for n in get_close_matches(name.lower(), by_lower, count, least))


def names_beside(path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names beside a missing file: those that look like its own, and those of the same kind."""
    if not path.parent.is_dir():
        return (), ()
    names = sorted(one.name for one in path.parent.iterdir() if not one.name.startswith("."))
    alike = tuple(name for name in names if Path(name).suffix.lower() == path.suffix.lower())
    return nearest(path.name, names), alike


def available(package: str) -> bool:
    """Whether an optional package can be imported."""
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def require(package: str, extra: str, what: str, where: str) -> None:
    """A `PackageError` if a package is not installed, which an extra of steelyard installs."""
    if not available(package):
        wrong = f"{what} need the package {package}, which is not installed"
        fix = f'pip install {package}, or pip install ".[{extra}]" in the source of steelyard'
        raise PackageError(wrong, where=where, fix=fix)

"""The one error root: every message says what is wrong, where, and how to correct it."""

from typing import Any


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
        self.wrong = wrong
        self.where = where
        self.fix = fix

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), *self.args)

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


def _again(kind: type[SteelyardError], wrong: str, where: str, fix: str) -> SteelyardError:
    """An error from what pickle kept of it."""
    return kind(wrong, where=where, fix=fix)

"""The functions that programs call: arguments compared with annotations, short tracebacks."""

import functools
import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from types import NoneType
from typing import Any, Literal, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

from steelyard.base.errors import DataError, SteelyardError, advice

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

NUMBERS: dict[Any, tuple[type, str]] = {
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
}
WORDS = {str: "a string", bool: "True or False", NoneType: "None"}


def checked(**least: float) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Refuse arguments of other types than the annotated ones, before anything is done.

    `least` are the least values of arguments that are numbers; also an attribute of the function,
    for its command. The traceback of a `SteelyardError` ends here, without the frames inside of the
    package and the errors that led to it, unless the environment variable `STEELYARD_TRACEBACK` is
    set.
    """

    def around(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        signature = inspect.signature(function)
        hints = functools.cache(lambda: get_type_hints(function))

        @functools.wraps(function)
        def run(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
            given = _bound(function.__name__, signature, args, kwargs)
            try:
                for name, value in given.items():
                    lowest = least.get(name)
                    if not _fits(value, hints()[name], lowest):
                        raise _refused(function.__name__, name, value, hints()[name], lowest)
                return function(*args, **kwargs)
            except SteelyardError as error:
                if os.environ.get("STEELYARD_TRACEBACK"):
                    raise
                # people read the next line in tracebacks, with its comment
                raise error.with_traceback(None) from None  # all frames: STEELYARD_TRACEBACK=1

        vars(run)["least"] = least
        return run

    return around


def built(kind: Callable[..., Result], /, **values: Any) -> Result:
    """A value of a class from what a file holds for its fields.

    Raises:
        ValueError: A field is not of its annotated type; arrays are left to the class.
    """
    hints = get_type_hints(kind)
    for name, value in values.items():
        hint = hints.get(name)
        plain = hint in (str, bool) or hint in NUMBERS or get_origin(hint) is Literal
        if plain and not _fits(value, hint, None):
            raise ValueError(f"'{name}' cannot be {str(value)[:60]!r}: give {_words(hint)}")
    return kind(**values)


def _bound(
    function: str, signature: inspect.Signature, args: Sequence[Any], kwargs: Mapping[str, Any]
) -> dict[str, Any]:
    """Arguments by name, as Python binds them; a `TypeError` names the function and the nearest."""
    try:
        return signature.bind(*args, **kwargs).arguments
    except TypeError as error:
        unknown = next((name for name in kwargs if name not in signature.parameters), None)
        near = "" if unknown is None else f"; {advice(unknown, signature.parameters, 'arguments')}"
        raise TypeError(f"steelyard.{function}: {error}{near}") from None


def _fits(value: Any, hint: Any, lowest: float | None) -> bool:
    """Whether a value is of an annotated type, its numbers at least the lowest."""
    if hint in NUMBERS:
        number = isinstance(value, NUMBERS[hint][0]) and not isinstance(value, bool)
        return number and (lowest is None or value >= lowest)
    origin = get_origin(hint)
    if origin is None:
        return isinstance(value, hint)
    if origin is Literal:
        return value in get_args(hint)
    if origin is Callable:
        return callable(value)
    if origin is type:
        return isinstance(value, type)
    if isinstance(origin, type) and issubclass(origin, Iterable):
        each = value if isinstance(value, list | tuple) else ()
        one = isinstance(value, str | bytes) or not isinstance(value, origin)
        return not one and all(_fits(x, get_args(hint)[0], lowest) for x in each)
    return any(_fits(value, kind, lowest) for kind in get_args(hint))


def _refused(function: str, name: str, value: Any, hint: Any, lowest: float | None) -> DataError:
    bound = "" if lowest is None else f" of at least {lowest:g}"
    shown = f"{value!r}" if isinstance(value, str | Real | NoneType) else type(value).__name__
    return DataError(
        f"argument '{name}' cannot be {shown[:60]}",
        where=f"steelyard.{function}",
        fix=f"give {_words(hint, bound)}",
    )


def _words(hint: Any, bound: str = "") -> str:
    if hint in NUMBERS:
        return NUMBERS[hint][1] + bound
    origin, kinds = get_origin(hint), get_args(hint)
    if origin is None:
        return WORDS.get(hint) or str(hint.__name__)
    if origin is Literal:
        return " or ".join(repr(choice) for choice in kinds)
    if origin is Callable:
        return "a function"
    if origin is type:
        return "a class"
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return f"a list, each of it {_words(kinds[0])}"
    return " or ".join(_words(kind, bound) for kind in kinds)

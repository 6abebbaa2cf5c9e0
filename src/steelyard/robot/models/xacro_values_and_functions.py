"""Values of xacro expressions, their limits of size, and the functions and methods on them."""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any

TEXT = 100_000  # characters of a text, and of a list or table with all that is in it
BITS = 4096  # binary digits of a whole number


class XacroError(Exception):
    """What is wrong in a xacro file, and how to correct it; its place is added by the caller."""

    def __init__(self, wrong: str, fix: str = "") -> None:
        super().__init__(wrong)
        self.wrong = wrong
        self.fix = fix or "correct the expression there"


def _too_long(what: str) -> XacroError:
    return XacroError(f"{what} is longer than {TEXT} characters")


class Budget:
    """The work that one expansion may take: elements, parts of expressions, characters."""

    def __init__(self, steps: int = 2_000_000) -> None:
        self.left = steps

    def spend(self, steps: int) -> None:
        """Take some of it; `XacroError` if there is none left."""
        self.left -= steps
        if self.left < 0:
            raise XacroError(
                "the file grows without end: its expansion was given up",
                "look for a macro or a property that repeats itself",
            )


def bounded(value: Any, budget: Budget) -> Any:
    """The value itself; `XacroError` if it is too large."""
    if isinstance(value, int) and value.bit_length() > BITS:
        raise XacroError(f"a whole number has more than {BITS} binary digits")
    if isinstance(value, complex):
        raise XacroError("a number is complex")
    size = _size(value, TEXT)
    if size > TEXT:
        raise _too_long("a text or a list")
    budget.spend(size // 16)
    return value


def _size(value: Any, most: int) -> int:
    """Characters, roughly; counted no further than a little beyond `most`."""
    size, waiting = 0, [value]
    while waiting and size <= most:
        part = waiting.pop()
        if isinstance(part, str):
            size += len(part)
        elif isinstance(part, list | tuple | set):
            size += 8 + 8 * len(part)
            waiting.extend(part if size <= most else ())
        elif isinstance(part, dict):
            size += 8 + 16 * len(part)
            inside: Iterable[Any] = (*part.keys(), *part.values()) if size <= most else ()
            waiting.extend(inside)
    return size


def literal(value: Any) -> Any:
    """A text as the number, truth value or quoted text that it writes, as xacro reads it."""
    if not isinstance(value, str):
        return value
    if len(value) >= 2 and value[0] == value[-1] == "'":
        return value[1:-1]
    if "_" in value:
        return value
    for reading in (int, float):
        with suppress(ValueError):
            return reading(value)
    return {"true": True, "True": True, "false": False, "False": False}.get(value, value)


def as_truth(value: Any, text: str) -> bool:
    """The truth of a condition; `XacroError` if it has none."""
    if not isinstance(value, str):
        return bool(value)
    if value in ("true", "True", "false", "False"):
        return value.lower() == "true"
    try:
        return bool(int(value))
    except ValueError:
        raise XacroError(
            f"the condition '{text}' gives '{value[:80]}', which is neither true nor false",
            "let it give true, false or a number",
        ) from None


def remainder(left: Any, right: Any) -> Any:
    """`left % right` of numbers, or numbers in a text; `XacroError` if it may be wide."""
    if not isinstance(left, str):
        return left % right
    if "*" in left or re.search(r"\d{4}", left):
        raise XacroError(f"the format '{left[:80]}' is not supported: it may be wide")
    if left.count("%") * _size(right, TEXT) > 10 * TEXT:
        raise _too_long("a text")
    return left % (tuple(right) if isinstance(right, list) else right)


def power(base: Any, exponent: Any) -> Any:
    """`base ** exponent`; `XacroError` instead of giant whole numbers."""
    whole = isinstance(base, int) and isinstance(exponent, int) and exponent > 0
    if whole and base.bit_length() * exponent > 2 * BITS:
        raise XacroError(f"a power has more than {BITS} binary digits")
    return base**exponent


def product(left: Any, right: Any) -> Any:
    """`left * right`; `XacroError` instead of giant texts or lists."""
    for many, times in ((left, right), (right, left)):
        repeated = isinstance(many, str | list | tuple) and isinstance(times, int)
        if repeated and len(many) * times > TEXT:
            raise _too_long("a text or a list")
    return left * right


def rounded(number: Any, digits: int = 0) -> Any:
    """Python's `round`, with a sensible number of digits."""
    if not math.isfinite(number) or abs(digits) > 300:
        raise XacroError(f"{number} cannot be rounded to {digits} digits")
    return round(number, digits) if digits else round(number)


def counted(*bounds: int) -> list[int]:
    """Python's `range`, as a list."""
    numbers = range(*bounds)
    if numbers.__len__() > TEXT // 8:
        raise _too_long("a text or a list")
    return list(numbers)


_MATH = (
    "acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh degrees exp fabs floor fmod "
    "hypot isclose isfinite isinf isnan log log10 log2 pow radians sin sinh sqrt tan tanh trunc"
)
MATH: Mapping[str, Any] = {
    **{name: getattr(math, name) for name in _MATH.split()},
    "pi": math.pi,
    "e": math.e,
    "tau": math.tau,
    "inf": math.inf,
    "nan": math.nan,
}
_BUILT_IN = (abs, all, any, bool, dict, float, int, len, list, max, min, sorted, str, sum, tuple)
PYTHON: Mapping[str, Any] = {
    **{function.__name__: function for function in _BUILT_IN},
    "enumerate": lambda *given: list(enumerate(*given)),
    "range": counted,
    "round": rounded,
    "zip": lambda *given: list(zip(*given, strict=False)),
}
FUNCTIONS: Mapping[str, Any] = {
    **MATH,
    **PYTHON,
    "true": True,
    "false": False,
    "math": MATH,
    "python": PYTHON,
}
"""Names that every expression knows."""


def _replaced(text: str, old: str, new: str) -> str:
    if (len(text) // max(len(old), 1) + 1) * len(new) > TEXT:
        raise _too_long("a text")
    return text.replace(old, new)


def _joined(text: str, parts: list[str]) -> str:
    if len(text) * len(parts) > TEXT:
        raise _too_long("a text")
    return text.join(parts)


METHODS: Mapping[type, Mapping[str, Callable[..., Any]]] = {
    str: {
        **{
            name: getattr(str, name)
            for name in "count endswith find isdigit lower lstrip rstrip split startswith strip "
            "title upper".split()
        },
        "join": _joined,
        "replace": _replaced,
    },
    dict: {
        "get": dict.get,
        "items": lambda table: list(table.items()),
        "keys": lambda table: list(table),
        "values": lambda table: list(table.values()),
    },
    list: {"count": list.count, "index": list.index},
    tuple: {"count": tuple.count, "index": tuple.index},
}
"""Methods, by the type of the value before the dot."""

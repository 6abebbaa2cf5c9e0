"""Functions and methods that expressions of xacro files know."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from steelyard.robot.xacro.values import TEXT, XacroError, counted, rounded

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
PYTHON: Mapping[str, Any] = {
    "abs": abs,
    "all": all,
    "any": any,
    "bool": bool,
    "dict": dict,
    "enumerate": lambda *given: list(enumerate(*given)),
    "float": float,
    "int": int,
    "len": len,
    "list": list,
    "max": max,
    "min": min,
    "range": counted,
    "round": rounded,
    "sorted": sorted,
    "str": str,
    "sum": sum,
    "tuple": tuple,
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
        raise XacroError(f"a text is longer than {TEXT} characters")
    return text.replace(old, new)


def _joined(text: str, parts: list[str]) -> str:
    if len(text) * len(parts) > TEXT:
        raise XacroError(f"a text is longer than {TEXT} characters")
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

"""All methods of `[processing]` by the names they have in files."""

import dataclasses
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, get_type_hints

from steelyard.errors import ModelError
from steelyard.measurement.methods.auto import Auto
from steelyard.measurement.methods.butterworth import Butterworth
from steelyard.measurement.methods.fir import FIR
from steelyard.measurement.methods.fourier import Fourier
from steelyard.measurement.methods.kalman import Kalman
from steelyard.measurement.methods.moving_average import MovingAverage
from steelyard.measurement.methods.protocols import Method, Smoother
from steelyard.measurement.methods.savitzky_golay import SavitzkyGolay
from steelyard.measurement.methods.spline import SmoothingSpline
from steelyard.robot_file.sections import as_declared

METHODS: dict[str, type[Any]] = {
    method.name: method
    for method in (
        Auto,
        Butterworth,
        FIR,
        SavitzkyGolay,
        MovingAverage,
        Fourier,
        Kalman,
        SmoothingSpline,
    )
}
"""Ways from positions to motion, for `motion = ...`."""

SMOOTHERS: dict[str, type[Any]] = {
    method.name: method for method in (Butterworth, FIR, SavitzkyGolay, MovingAverage)
}
"""Ways to smooth efforts, for `effort = ...`."""


def method_of(description: str | Mapping[str, Any], where: str) -> Method:
    """A method from its name, or from a table with its name under `method` and its settings.

    Raises:
        ModelError: There is no such method, or it has no such setting or value.
    """
    method: Method = _built(METHODS, "motion", description, where)
    return method


def smoother_of(description: str | Mapping[str, Any], where: str) -> Smoother:
    """A smoother of efforts, likewise."""
    smoother: Smoother = _built(SMOOTHERS, "effort", description, where)
    return smoother


def description_of(method: Method | Smoother) -> dict[str, Any]:
    """The table that `method_of` or `smoother_of` turns back into the method."""
    fields = {x: getattr(method, x) for x in _names(type(method))}
    return {
        "method": method.name,
        **{x: list(v) if isinstance(v, tuple) else v for x, v in fields.items() if v is not None},
    }


def in_words(method: Method | Smoother) -> str:
    """Name and settings that are not the default: `savitzky_golay, degree 4`."""
    usual = {field.name: field.default for field in dataclasses.fields(method)}  # type: ignore[arg-type]
    told = [(x, getattr(method, x)) for x in usual]
    words = [f"{x.replace('_', ' ')} {_shown(value)}" for x, value in told if value != usual[x]]
    return ", ".join((method.name.replace("_", " "), *words))


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_shown, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _built(
    register: Mapping[str, type[Any]], key: str, description: str | Mapping[str, Any], where: str
) -> Any:
    given: dict[str, Any] = (
        {"method": description} if isinstance(description, str) else dict(description)
    )
    name = str(given.pop("method", ""))
    if name not in register:
        near = get_close_matches(name, register, n=1)
        wrong = (
            f"'{name}' is not a method for {key}" if name else "the table does not name its method"
        )
        raise ModelError(
            wrong,
            where=where,
            mend=f"did you mean '{near[0]}'?" if near else f"use one of {', '.join(register)}",
        )
    method = register[name]
    fields = {field: _checked(method, field, value, where) for field, value in given.items()}
    try:
        return method(**fields)
    except ModelError as error:
        raise ModelError(error.wrong, where=where, mend=error.mend) from None


def _checked(method: type[Any], field: str, value: Any, where: str) -> Any:
    """One setting as its type says, strictly.

    Raises:
        ModelError: The method has no such setting, or it is of another type.
    """
    known = _names(method)
    if field not in known:
        near = get_close_matches(field, known, n=1)
        listed = ", ".join(known) or "none: it has no settings"
        raise ModelError(
            f"method '{method.name}' has no setting '{field}'",
            where=where,
            mend=f"did you mean '{near[0]}'?" if near else f"its settings are: {listed}",
        )
    try:
        return as_declared(get_type_hints(method)[field], value)
    except ValueError as error:
        raise ModelError(
            f"method '{method.name}' has {field} = {value!r}: {error}",
            where=where,
            mend="see the settings of [processing] in docs/processing.md",
        ) from None


def _names(method: type[Any]) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(method))

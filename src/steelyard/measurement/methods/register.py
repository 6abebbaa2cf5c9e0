"""All methods of `[processing]` by the names they have in files."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from steelyard.measurement.methods.auto import Auto
from steelyard.measurement.methods.butterworth import Butterworth
from steelyard.measurement.methods.fir import FIR
from steelyard.measurement.methods.fourier import Fourier
from steelyard.measurement.methods.kalman import Kalman, KalmanSmoother
from steelyard.measurement.methods.kalman_filter import CausalKalman
from steelyard.measurement.methods.moving_average import MovingAverage
from steelyard.measurement.methods.protocols import Method, Smoother
from steelyard.measurement.methods.savitzky_golay import SavitzkyGolay
from steelyard.measurement.methods.spline import SmoothingSpline
from steelyard.robot_file.described import Kinds

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
        CausalKalman,
        SmoothingSpline,
    )
}
"""Ways from positions to motion, for `motion = ...`."""

SMOOTHERS: dict[str, type[Any]] = {
    method.name: method
    for method in (Butterworth, FIR, SavitzkyGolay, MovingAverage, KalmanSmoother)
}
"""Ways to smooth efforts, for `effort = ...`."""

_MOTION = Kinds(METHODS, "method", "method for motion", "method")
_EFFORT = Kinds(SMOOTHERS, "method", "method for effort", "method")


def method_of(description: str | Mapping[str, Any], where: str) -> Method:
    """A method from its name, or from a table with its name under `method` and its settings.

    Raises:
        ModelError: There is no such method, or it has no such setting or value.
    """
    method: Method = _MOTION.built(description, where)
    return method


def smoother_of(description: str | Mapping[str, Any], where: str) -> Smoother:
    """A smoother of efforts, likewise."""
    smoother: Smoother = _EFFORT.built(description, where)
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
    values = [(x, getattr(method, x)) for x in usual]
    words = [f"{x.replace('_', ' ')} {_shown(value)}" for x, value in values if value != usual[x]]
    return ", ".join((method.name.replace("_", " "), *words))


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_shown, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _names(method: type[Any]) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(method))

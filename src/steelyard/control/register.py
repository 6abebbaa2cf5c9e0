"""Controllers by the names that options know them by."""

from dataclasses import fields
from math import isfinite
from typing import Any

from steelyard.control.cascade import Cascade
from steelyard.control.computed_torque import ComputedTorque
from steelyard.control.pd import PD
from steelyard.control.pid import PID
from steelyard.control.protocol import Control
from steelyard.control.torque_feedforward import TorqueFeedforward
from steelyard.errors import ModelError
from steelyard.model import ValuedModel
from steelyard.suggest import advice

CONTROLS: tuple[type[Any], ...] = (PD, PID, Cascade, ComputedTorque)
"""All controllers. Their numbers are gains, above zero; `friction` is 0 or 1."""


def control_of(text: str, model: ValuedModel | None = None) -> Control:
    """The controller of a text such as `cascade` or `computed_torque,kp=100,kv=5`.

    Args:
        text: Name, and gains after commas.
        model: Model with values; feedforward for controllers that do not compute with it.

    Raises:
        ModelError: There is none, a gain is no number above zero, or the model is missing.
    """
    name, *given = text.split(",")
    kinds = {kind.kind: kind for kind in CONTROLS}
    if name not in kinds:
        raise ModelError(
            f"there is no controller '{name}'",
            where="--control",
            fix=advice(name, kinds, "controllers"),
        )
    kind = kinds[name]
    gains = dict(_gain(one, kind, text) for one in given)
    if not kind.needs_model:
        control: Control = kind(**gains)
        return control if model is None else TorqueFeedforward(control, model)
    if model is None:
        raise ModelError(
            f"controller '{name}' computes with a model, and none is given",
            where="--control",
            fix="add --model MODEL, or use pd, pid or cascade",
        )
    found: Control = kind(model, **gains)
    return found


def _gain(text: str, kind: type[Any], whole: str) -> tuple[str, float | bool]:
    """Name and value of one gain."""
    name, _, number = text.partition("=")
    known = [field.name for field in fields(kind) if field.name != "model"]
    if name not in known:
        raise ModelError(
            f"controller '{kind.kind}' has no gain '{name}'",
            where=f"--control {whole}",
            fix=advice(name, known, "gains"),
        )
    if name == "friction" and number in ("0", "1"):
        return name, number == "1"
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if name == "friction" or not (isfinite(value) and value > 0.0):
        raise ModelError(
            f"'{number}' is no value of '{name}'",
            where=f"--control {whole}",
            fix="give friction=0 or friction=1"
            if name == "friction"
            else f"give a number above zero, such as {name}=100",
        )
    return name, value

"""Criteria and stopping rules by the names that options know them by."""

from collections.abc import Callable
from math import isfinite

from steelyard.errors import ModelError
from steelyard.estimation.reduction.criteria import CRITERIA, Criterion
from steelyard.estimation.reduction.rules import (
    Bic,
    ConditionLimit,
    Count,
    DeviationRatio,
    OneFewer,
    OneStandardError,
    Refit,
    StoppingRule,
    Tolerance,
)
from steelyard.suggest import advice

RULES: dict[type[StoppingRule], Callable[[float], StoppingRule] | None] = {
    OneStandardError: None,
    Tolerance: lambda percent: Tolerance(0.01 * percent),
    Bic: None,
    ConditionLimit: ConditionLimit,
    DeviationRatio: DeviationRatio,
    Count: lambda parameters: Count(int(parameters)),
    OneFewer: None,
    Refit: None,
}
"""Stopping rules, and how each is made from the number behind its name, if it takes one."""


def criterion_of(name: str) -> Criterion:
    """The criterion of a name.

    Raises:
        ModelError: There is none.
    """
    known = {criterion.name: criterion for criterion in CRITERIA}
    if name not in known:
        raise ModelError(
            f"there is no criterion '{name}'",
            where="--criterion",
            fix=advice(name, known, "criteria"),
        )
    return known[name]


def rule_of(text: str) -> StoppingRule:
    """The stopping rule of a text such as `bic` or `tolerance=5`.

    Raises:
        ModelError: There is none, or its number is missing or none.
    """
    name, equals, number = text.partition("=")
    known = {rule.name: rule for rule in RULES}
    if name not in known:
        raise ModelError(
            f"there is no stopping rule '{name}'",
            where="--stop",
            fix=advice(name, known, "stopping rules"),
        )
    kind = known[name]
    make = RULES[kind]
    if make is None and equals:
        raise ModelError(
            f"stopping rule '{name}' takes no number", where="--stop", fix=f"--stop {name}"
        )
    if not equals and kind is not Count:
        return kind()
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if make is None or not isfinite(value) or not value > 0.0 or (kind is Count and value % 1.0):
        raise ModelError(
            f"'{number}' is no number that stopping rule '{name}' can use",
            where=f"--stop {text}",
            fix="give a whole number, such as count=25"
            if kind is Count
            else f"give a number above zero, such as {name}=5",
        )
    return make(value)

"""Rows of the parameters' table, for the page, the terminal and the file alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from steelyard.estimation.estimate import Z95, Unidentifiable

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel

WEAK = 20.0
"""Relative standard deviation [%] above which a parameter is called weak."""

AT_BOUND = 0.01
"""Distance from a bound, in standard deviations, that is taken for rounding of a value there.
"""

LEARNED = 20.0
"""Share from data [%] below which a parameter is called known from the prior."""

Grade = Literal["sure", "weak", "zero", "prior", "bound", "unseen", "removed", "known"]


@dataclass(frozen=True)
class Row:
    """One base parameter; numbers are `None` where the data do not see it.

    Attributes:
        name: The parameter that leads the group.
        group: The base parameter in full.
        unit: Unit.
        value: Estimated value.
        std: Standard deviation.
        lower: Lower end of the 95 % interval.
        upper: Upper end of the 95 % interval.
        relative_percent: Standard deviation relative to the value [%].
        nominal: Value in the robot's file; `None` if unknown.
        grade: `sure`, `weak` (relative standard deviation above 20 %), `zero` (the interval holds
            zero), `prior` (less than 20 % of it are from the data), `bound` (a bound holds it, so
            that it has no interval), `unseen`, `removed` (the model was reduced by it: zero), or
            `known` (a prior constraint gives its value, it was not estimated).
        status: The same in words.
        learned_percent: Share that comes from the data [%]; `None` without a prior.
    """

    name: str
    group: str
    unit: str
    value: float | None
    std: float | None
    lower: float | None
    upper: float | None
    relative_percent: float | None
    nominal: float | None
    grade: Grade
    status: str
    learned_percent: float | None = None


def rows(identified: IdentifiedModel) -> tuple[Row, ...]:
    """All base parameters in structural order."""
    base, estimate = identified.base, identified.estimate
    nominal = nominal_values(identified)
    groups = {name: base.grouping(k) for k, name in enumerate(base.base_names)}
    units = dict(zip(base.base_names, base.base_units, strict=True))
    learned = [None] * len(estimate.parameters)
    if estimate.learned is not None:
        learned = (100.0 * estimate.learned).tolist()
    seen = {
        name: _seen(name, groups.get(name, name), unit, value, std, nominal.get(name), share)
        for name, unit, value, std, share in zip(
            estimate.parameters.names,
            estimate.parameters.units,
            estimate.parameters.values.tolist(),
            estimate.std.tolist(),
            learned,
            strict=True,
        )
    }
    bounds = {p.name: (p.lower, p.upper) for p in identified.model.parameters}
    for name in estimate.at_bound:
        seen[name] = _at_bound(seen[name], bounds.get(seen[name].group, ()))
    for name in estimate.known:
        seen[name] = _known(seen[name])
    blind = {b.name: _blind(b, groups, units, nominal.get(b.name)) for b in estimate.blind}
    removed = {
        r.name: replace(
            _blind(Unidentifiable(r.name), groups, units, nominal.get(r.name)),
            value=0.0,
            grade="removed",
            status=f"removed in step {r.step}: zero",
        )
        for r in estimate.removed
    }
    found = seen | blind | removed
    order = [name for name in groups if name in found]
    order += [name for name in found if name not in groups]
    return tuple(found[name] for name in order)


def nominal_values(identified: IdentifiedModel) -> dict[str, float]:
    """Nominal base parameters by name, of groups whose members are all known."""
    base = identified.base
    priors = [parameter.prior for parameter in identified.model.parameters]
    values = base.base_values([0.0 if prior is None else prior for prior in priors])
    unknown = np.array([prior is None for prior in priors])
    mixed = np.any((base.lift != 0.0) & unknown, axis=1)
    return {
        name: float(value)
        for name, value, hidden in zip(base.base_names, values, mixed, strict=True)
        if not hidden
    }


def _seen(
    name: str,
    group: str,
    unit: str,
    value: float,
    std: float,
    nominal: float | None,
    learned: float | None,
) -> Row:
    relative = 100.0 * std / abs(value) if value else float("inf")
    grade: Grade = "sure"
    status = "identified"
    if learned is not None and learned < LEARNED:
        grade, status = "prior", "from the prior"
    elif not Z95 * std < abs(value):
        grade, status = "zero", "not significantly different from zero"
    elif not relative <= WEAK:
        grade, status = "weak", "poorly identifiable"
    return Row(
        name,
        group,
        unit,
        value,
        std,
        value - Z95 * std,
        value + Z95 * std,
        relative,
        nominal,
        grade,
        status,
        learned,
    )


def _at_bound(row: Row, bounds: Sequence[float]) -> Row:
    """A row whose value a bound holds, at the model's bound where only rounding lies between."""
    value, std = row.value or 0.0, row.std or 0.0
    near = [bound for bound in bounds if abs(value - bound) <= AT_BOUND * std]
    return replace(
        row,
        value=near[0] if near else value,
        std=None,
        lower=None,
        upper=None,
        relative_percent=None,
        learned_percent=None,
        grade="bound",
        status="at its bound",
    )


def _known(row: Row) -> Row:
    """A row whose value was not estimated."""
    return replace(_at_bound(row, ()), std=0.0, grade="known", status="known")


def _blind(
    blind: Unidentifiable, groups: dict[str, str], units: dict[str, str], nominal: float | None
) -> Row:
    tied = f" (tied to {', '.join(blind.tied_to)})" if blind.tied_to else ""
    return Row(
        blind.name,
        groups.get(blind.name, blind.name),
        units.get(blind.name, ""),
        None,
        None,
        None,
        None,
        None,
        nominal,
        "unseen",
        f"not identifiable{tied}",
    )

"""Rows of the parameters' table, for the page, the terminal, files and Python alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from steelyard.estimation.estimate import Z95
from steelyard.estimation.status import Status, statuses
from steelyard.regression.khalil_symbols import symbols

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel

AT_BOUND = 0.01
"""Distance from a bound, in standard deviations, that is taken for rounding of a value there.
"""


@dataclass(frozen=True)
class Row:
    """One base parameter; its fields are the columns of `parameters.csv`.

    Attributes:
        name: The parameter that leads the group.
        group: The base parameter in full.
        value: Estimated value; `None` where the data do not identify it.
        unit: Unit.
        std: Standard deviation; `None` without an estimate, as the next three.
        lower95: Lower end of the 95 % interval.
        upper95: Upper end of the 95 % interval.
        relative_std_percent: Standard deviation relative to the value [%].
        status: How well it is identified.
        remark: What else the status says: the step of a removal, inseparable parameters.
        symbol: Its customary symbol.
        from_data_percent: Share that comes from the data [%]; `None` without a prior.
        nominal: Value in the robot's file; `None` if unknown.
    """

    name: str
    group: str
    value: float | None
    unit: str
    std: float | None
    lower95: float | None
    upper95: float | None
    relative_std_percent: float | None
    status: Status
    remark: str
    symbol: str
    from_data_percent: float | None
    nominal: float | None


def rows(identified: IdentifiedModel) -> tuple[Row, ...]:
    """All base parameters in structural order."""
    base, estimate = identified.base, identified.estimate
    nominal, status = nominal_values(identified), statuses(identified)
    groups = {name: base.grouping(k) for k, name in enumerate(base.base_names)}
    units = dict(zip(base.base_names, base.base_units, strict=True))
    units |= dict(zip(estimate.parameters.names, estimate.parameters.units, strict=True))
    symbol = dict(zip(base.base_names, symbols(identified.model.robot, base), strict=True))
    bounds = {p.name: (p.lower, p.upper) for p in identified.model.parameters}
    remarks = {b.name: f"tied to {', '.join(b.tied_to)}" for b in estimate.blind if b.tied_to}
    remarks |= {r.name: f"in step {r.step}" for r in estimate.removed}
    empty = {
        name: Row(
            name=name,
            group=groups.get(name, name),
            value=0.0 if status[name] == "removed" else None,
            unit=units.get(name, ""),
            std=None,
            lower95=None,
            upper95=None,
            relative_std_percent=None,
            status=status[name],
            remark=remarks.get(name, ""),
            symbol=symbol.get(name, name),
            from_data_percent=None,
            nominal=nominal.get(name),
        )
        for name in status
    }
    learned: list[float | None] = [None] * len(estimate.parameters)
    if estimate.learned is not None:
        learned = (100.0 * estimate.learned).tolist()
    estimated = {
        name: _estimated(empty[name], value, std, share, bounds.get(empty[name].group, ()))
        for name, value, std, share in zip(
            estimate.parameters.names,
            estimate.parameters.values.tolist(),
            estimate.std.tolist(),
            learned,
            strict=True,
        )
    }
    found = empty | estimated
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


def _estimated(
    row: Row, value: float, std: float, from_data: float | None, bounds: Sequence[float]
) -> Row:
    """A row with its value, and with an interval unless the value is given or at a bound.

    At a bound of the model the value is that bound where only rounding lies between.
    """
    if row.status == "known":
        return replace(row, value=value, std=0.0)
    if row.status == "at a bound":
        near = [bound for bound in bounds if abs(value - bound) <= AT_BOUND * std]
        return replace(row, value=near[0] if near else value)
    return replace(
        row,
        value=value,
        std=std,
        lower95=value - Z95 * std,
        upper95=value + Z95 * std,
        relative_std_percent=100.0 * std / abs(value) if value else inf,
        from_data_percent=from_data,
    )

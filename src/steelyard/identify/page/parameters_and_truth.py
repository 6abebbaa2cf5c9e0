"""The table of base parameters: values, 95 % intervals, status, and the simulated truth."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import Z95, records
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import symbols
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import (
    FROM_DATA,
    SMALL,
    WELL,
    ParameterStatus,
    statuses,
)
from steelyard.identify.page.link_inertias_and_ellipsoids import whole_body_words
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.model.laws.register import description_of
from steelyard.report.page import FigureSection, Numbers, Section
from steelyard.report.page_figures import Figure, Group, Key, dots, figure_of_rows
from steelyard.report.tables import table_of
from steelyard.report.words import count, first_names, rounded_to_uncertainty, significant

AT_BOUND = 0.01  # distance in standard deviations that is taken for rounding


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """One base parameter; its fields are the columns of `parameters.csv`."""

    name: str  # the parameter that leads the group
    group: str  # the base parameter in full
    value: float | None  # estimated value; `None` where the data do not identify it
    unit: str
    std: float | None = None  # standard deviation; `None` without an estimate, as the next three
    lower95: float | None = None  # lower end of the 95 % interval
    upper95: float | None = None  # upper end of the 95 % interval
    relative_std_percent: float | None = None  # standard deviation relative to the value [%]
    status: ParameterStatus
    remark: str  # what else the status says: the step of a removal, inseparable parameters
    symbol: str
    from_data_percent: float | None = None  # share from the data [%]; `None` without a prior
    nominal: float | None  # value in the robot's file; `None` if unknown


def parameter_rows(identified: IdentifiedModel) -> tuple[ParameterRow, ...]:
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
    learned: list[float | None] = [None] * len(estimate.parameters)
    if estimate.learned is not None:
        learned = (100.0 * estimate.learned).tolist()
    numbers = (estimate.parameters.values.tolist(), estimate.std.tolist(), learned)
    estimated = dict(zip(estimate.parameters.names, zip(*numbers, strict=True), strict=True))
    found = []
    order = [name for name in groups if name in status]
    for name in (*order, *(name for name in status if name not in groups)):
        row = ParameterRow(
            name=name,
            group=groups.get(name, name),
            value=0.0 if status[name] == "removed" else None,
            unit=units.get(name, ""),
            status=status[name],
            remark=remarks.get(name, ""),
            symbol=symbol.get(name, name),
            nominal=nominal.get(name),
        )
        if name in estimated:
            row = _estimated(row, *estimated[name], bounds.get(row.group, ()))
        found.append(row)
    return tuple(found)


def nominal_values(identified: IdentifiedModel) -> dict[str, float]:
    """Nominal base parameters by name, of groups whose members are all known."""
    base = identified.base
    priors = [parameter.prior for parameter in identified.model.parameters]
    values = base.base_values([0.0 if prior is None else prior for prior in priors])
    unknown = np.array([prior is None for prior in priors])
    mixed = np.any((base.lift != 0.0) & unknown, axis=1)
    each = zip(base.base_names, values.tolist(), mixed, strict=True)
    return {name: value for name, value, hidden in each if not hidden}


def _estimated(
    row: ParameterRow, value: float, std: float, from_data: float | None, bounds: Sequence[float]
) -> ParameterRow:
    """A row with its value, and with an interval unless the value is given or at a bound.

    At a bound of the model the value is that bound where only rounding lies between.
    """
    if row.status == "known":
        return replace(row, value=value, std=0.0)
    if row.status == "at a bound":
        near = [bound for bound in bounds if abs(value - bound) <= AT_BOUND * std]
        return replace(row, value=near[0] if near else value)
    relative, lower, upper = inf, value - Z95 * std, value + Z95 * std
    if value:
        relative = 100.0 * std / abs(value)
    row = replace(row, value=value, std=std, lower95=lower, upper95=upper)
    return replace(row, relative_std_percent=relative, from_data_percent=from_data)


STATUS_ORDER: tuple[ParameterStatus, ...] = (
    "identified",
    "small effect",
    "poorly identified",
    "at a bound",
    "known",
    "from the prior",
    "not identifiable",
)
"""How the line of the terminal counts the parameters."""

SUFFICIENT: tuple[ParameterStatus, ...] = ("identified", "small effect", "known", "removed")
"""Parameters of which another motion would change little."""

ONE_BY_ONE = (
    "For predictions use the whole model; rely on single values only if identified, and on several "
    "friction laws of a joint only as one curve."
)

MOST_NAMED_PARAMETERS = 8  # most parameters that a line of the terminal names


class ParametersSection(Section, name="parameters", title="Parameters", template="parameters.html"):
    """A table of base parameters, with the status of each."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Rows of the parameters that the data see."""
        identified, base = content.identified, content.identified.base
        table = [row for row in parameter_rows(identified) if row.status != "not identifiable"]
        members = np.count_nonzero(base.lift, axis=1).tolist()
        terms = dict(zip(base.base_names, members, strict=True))
        sizes = [terms.get(row.name, 1) for row in table]
        std = [row.relative_std_percent for row in table]
        bars = [100.0 if relative is None else min(100.0, relative) for relative in std]
        each = zip(table, bars, sizes, strict=True)
        return {
            "rows": [{**vars(row), "bar": bar, "others": n - 1} for row, bar, n in each],
            "grouped": any(members > 1 for members in sizes),
            "nominal": any(row.nominal is not None for row in table),
            "estimator": identified.estimate.estimator,
            "counts": counts(table),
            "statuses": {row.status for row in table},
            "learned": any(row.from_data_percent is not None for row in table),
            "well": WELL,
            "small": SMALL,
            "from_data": FROM_DATA,
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The parameters that the data see, the names of the others, and the conditioning."""
        estimate = content.identified.estimate
        known, status = estimate.parameters, statuses(content.identified)
        rows = records(name=known.names, unit=known.units, value=known.values, std=estimate.std)
        return {
            "n_base_parameters": len(content.identified.base),
            "parameters": [{**row, "status": status[row["name"]]} for row in rows],
            "terms": [description_of(term) for term in content.identified.model.terms],
            "not_seen": [blind.name for blind in estimate.blind],
            "removed": [vars(one) for one in estimate.removed],
            "known": list(estimate.known),
            "condition": estimate.condition,
            "condition_normalised": estimate.condition_normalised,
        }

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How many parameters there are, and how many the data show poorly or not at all."""
        yield Text("\n".join(usable(content.identified)))

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """Which the data show poorly or not at all."""
        table = parameter_rows(content.identified)
        condition = significant(content.identified.estimate.condition_normalised)
        order = ("removed", *STATUS_ORDER[1:])
        names = {status: [x.name for x in table if x.status == status] for status in order}
        left = count(len(table) - len(names["removed"]), "base parameter")
        lines = [f"{left}, normalised condition number {condition}"]
        for status, chosen in names.items():
            if chosen:
                words = "removed, taken as zero" if status == "removed" else status
                listed = first_names(chosen, MOST_NAMED_PARAMETERS)
                lines.append(f"{len(chosen)} {words}: {listed}")
        yield Text("\n".join(lines))


def usable(identified: IdentifiedModel) -> tuple[str, ...]:
    """Counts of the parameters by status, what to use them for, and what the whole robot weighs."""
    table = parameter_rows(identified)
    removed = sum(row.status == "removed" for row in table)
    taken = f"; {removed} removed, taken as zero" if removed else ""
    words = f"{count(len(table) - removed, 'base parameter')}: {counts(table)}{taken}"
    good = all(row.status in SUFFICIENT for row in table)
    return tuple(filter(None, (words, "" if good else ONE_BY_ONE, whole_body_words(identified))))


def counts(table: Sequence[ParameterRow]) -> str:
    """Like `40 identified, 3 small effect`, without removed parameters."""
    numbers = ((status, sum(row.status == status for row in table)) for status in STATUS_ORDER)
    return ", ".join(f"{number} {status}" for status, number in numbers if number)


@dataclass(frozen=True)
class TrueParameter:
    """A base parameter of a simulated robot with its estimate and its 95 % interval."""

    name: str
    unit: str
    truth: float
    value: float
    half_width: float

    @property
    def distance(self) -> float:
        """Estimate minus truth in half-widths."""
        return (self.value - self.truth) / self.half_width

    @property
    def inside(self) -> bool:
        """Whether the truth lies in the 95 % interval."""
        return abs(self.distance) <= 1.0


class TruthSection(FigureSection, name="truth", title="Simulated robot: truth and estimate"):
    """One row per base parameter."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Truth, estimates and distances, if the truth is known."""
        found = true_parameters(content)
        if not found:
            return None
        columns: dict[str, Callable[[TrueParameter], str]] = {
            "Parameter": lambda x: x.name,
            "Truth": lambda x: rounded_to_uncertainty(x.truth, x.half_width),
            "Estimate": lambda x: rounded_to_uncertainty(x.value, x.half_width),
            "95 % interval": lambda x: f"± {significant(x.half_width, 2)}",
            "Unit": lambda x: x.unit,
            "Truth inside": lambda x: "yes" if x.inside else "no",
        }
        return {
            "words": f"{_truth_sentence(found)} Of 100 such intervals, 95 hold the truth on "
            "average, if the model lacks nothing.",
            "legend": [
                Key("--green", "truth inside the 95 % interval", "point"),
                Key("--vermillion", "outside", "point"),
                Key("--rest", "95 % interval", "area"),
            ],
            "groups": [Group([_truth_figure(found)], columns="one")],
            "tables": [table_of(found, columns, text=(0, 4, 5))],
            "folded": "Values of all parameters",
            "note": "The robot of this report is simulated. A real robot has no known truth: "
            "validation runs and the checks of the residuals take its place.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Truth and estimates."""
        found = true_parameters(content)
        return {"truth": [vars(one) | {"inside": one.inside} for one in found] or None}

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How many intervals hold the truth."""
        if found := true_parameters(content):
            yield Text(_truth_sentence(found))


def true_parameters(content: ReportContent) -> list[TrueParameter]:
    """Base parameters with intervals beside their true values; none without a truth."""
    if content.truth is None:
        return []
    base, known = content.identified.base, content.truth.as_dict()
    values = base.base_values([known[name] for name in base.names])
    true = dict(zip(base.base_names, values, strict=True))
    return [
        TrueParameter(row.name, row.unit, float(true[row.name]), row.value, Z95 * row.std)
        for row in parameter_rows(content.identified)
        if row.name in true and row.value is not None and row.std is not None and row.std > 0.0
    ]


def _truth_sentence(found: Sequence[TrueParameter]) -> str:
    inside = sum(one.inside for one in found)
    total = count(len(found), "base parameter")
    return f"Simulated robot: the true values of {inside} of {total} lie in the 95 % intervals."


def _truth_figure(found: Sequence[TrueParameter]) -> Figure:
    """Distances from the truth in half-widths."""
    band = {"type": "rect", "xref": "x", "yref": "paper", "x0": -1, "x1": 1, "y0": 0, "y1": 1}
    inside = [one for one in found if one.inside], "inside", "--green", "circle"
    outside = [one for one in found if not one.inside], "outside", "--vermillion", "diamond"
    traces = [
        dots(words, [one.distance for one in some], [one.name for one in some], colour, symbol=mark)
        for some, words, colour, mark in (inside, outside)
    ]
    return figure_of_rows(
        "Distance of every estimate from the truth",
        "estimate minus truth [half-widths]",
        [one.name for one in found],
        traces,
        14,
        shapes=[band | {"fillcolor": "--rest", "line": {"width": 0}, "layer": "below"}],
        xaxis={"zeroline": True},
        yaxis={"tickfont": {"size": 10}},
    )

"""Sections on parameters: conditioning, correlations, bootstrap, each log alone, other cut-offs."""

from collections.abc import Iterable, Mapping, Sequence
from math import hypot
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import Array
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import (
    Bootstrap,
    RepeatedEstimates,
    Sensitivity,
    Variation,
)
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.report.page import FigureSection, Numbers, Section, ValueSection, packed
from steelyard.report.page_figures import Figure, Group, row_height, traced
from steelyard.report.tables import PlainTable, Row, table_of, text_table
from steelyard.report.words import count, percent, significant
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

MOST_CORRELATED_PAIRS = 6  # most pairs of correlated parameters that are named
LEAST_NAMED_CORRELATION = 0.9  # correlation of two estimates from which on they are named


class ConditioningSection(
    Section, name="conditioning", title="Conditioning", template="conditioning.html"
):
    """Condition numbers, noise per joint, parameters that are hardly distinguished."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Figures of the estimate and of those beside it."""
        identified, estimate = content.identified, content.identified.estimate
        robot, figures = identified.robot, (estimate.sigma.tolist(), estimate.n_samples.tolist())
        noise = zip(robot.joint_names, robot.effort_units, *figures, strict=True)
        names, matrix, _ = correlations(estimate, len(estimate.parameters))
        lower = np.tril(matrix, -1)
        order = np.argsort(np.abs(lower), axis=None)[::-1][:MOST_CORRELATED_PAIRS]
        places = [divmod(int(place), len(names)) for place in order]
        return {
            "estimate": estimate,
            "others": [(other, _furthest(estimate, other)) for other in identified.reference],
            "noise": list(noise),
            "pairs": [
                (names[b], names[a], float(lower[a, b]))
                for a, b in places
                if abs(lower[a, b]) >= LEAST_NAMED_CORRELATION
            ],
            "alike": LEAST_NAMED_CORRELATION,
        }


def _furthest(estimate: Estimate, other: Estimate) -> tuple[str, float] | None:
    """The shared parameter that two estimates differ most in, and how far.

    In standard deviations of both together, the root of the sum of their variances: what a prior
    holds in place may lie many of its own away from what the data alone say of it.
    """
    shared = [name for name in estimate.parameters.names if name in other.parameters.names]
    mine, others = (
        dict(zip(one.parameters.names, one.std.tolist(), strict=True)) for one in (estimate, other)
    )
    std = {name: hypot(mine[name], others[name]) for name in shared}
    apart = {name: abs(other.parameters[name] - estimate.parameters[name]) for name in shared}
    moved = {name: far / std[name] for name, far in apart.items() if std[name] > 0.0}
    return max(moved.items(), key=lambda one: one[1], default=None)


MOST_MAP_PARAMETERS = 80  # most parameters of a map

COLOUR_BAR = {
    **{"orientation": "h", "x": 0.5, "y": 1.0, "yanchor": "bottom", "len": 0.9, "thickness": 10},
    **{"title": {"text": "correlation [%]", "side": "top"}, "tickvals": [-100, -50, 0, 50, 100]},
}

CORRELATION_WORDS = (
    "Correlation of the estimates of every two base parameters. Two that are strongly correlated "
    "are known as a sum or difference only: errors of one are compensated by the other. Motions in "
    "which they act differently separate them, such as those of steelyard excite."
)


class CorrelationsSection(
    FigureSection, name="correlations", title="Correlation of the parameters"
):
    """One map."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The map of the most correlated parameters."""
        names, matrix, left_out = correlations(content.identified.estimate)
        if not names:
            return None
        note = "Parameters that a bound fixes are not in the map."
        if left_out:
            note += (
                f" To limit its size, it shows the {MOST_MAP_PARAMETERS} parameters with the "
                f"strongest correlations; {left_out} others are left out."
            )
        groups = [Group([_correlation_map(names, matrix)], columns="one")]
        return {"words": CORRELATION_WORDS, "groups": groups, "note": note}


def correlations(
    estimate: Estimate, most: int = MOST_MAP_PARAMETERS
) -> tuple[tuple[str, ...], Array, int]:
    """Names, correlations `(k, k)` of parameters with an error, and how many are left out.

    The `most` parameters with the strongest correlations stay.
    """
    std, covariance = estimate.std, estimate.covariance
    known = np.isfinite(covariance).all(axis=0) & (std > 0.0)
    known &= ~np.isin(estimate.parameters.names, estimate.at_bound)
    at = np.flatnonzero(known)
    matrix = covariance[np.ix_(at, at)] / std[at][:, None] / std[at]
    strongest = np.abs(matrix - np.eye(len(at))).max(axis=1, initial=0.0)
    kept = np.sort(np.argsort(-strongest, kind="stable")[:most])
    names = tuple(estimate.parameters.names[k] for k in at[kept])
    return names, matrix[np.ix_(kept, kept)], len(at) - len(kept)


def _correlation_map(names: tuple[str, ...], matrix: Array) -> Figure:
    """In percent, a byte each."""
    trace = traced(
        "points",
        "correlation",
        [*names],
        [*names],
        type="heatmap",
        z={**packed(np.rint(100.0 * matrix), "i1"), "shape": f"{len(names)}, {len(names)}"},
        **{"zmin": -100, "zmax": 100},
        colorscale=[[0.0, "--blue"], [0.5, "--card"], [1.0, "--vermillion"]],
        colorbar=COLOUR_BAR,
        hovertemplate="%{y}, %{x}: %{z} %<extra></extra>",
    )
    layout = {
        "xaxis": {"showticklabels": False, "showgrid": False, "ticks": ""},
        "yaxis": {
            "autorange": "reversed",
            "tickfont": {"size": 9},
            "dtick": 1,
            "showgrid": False,
            "zeroline": False,
        },
    }
    label = "Map of the correlations between all pairs of parameters, both ways in the same order"
    return Figure("", label, "", "", [trace], layout, height=row_height(len(names), 12))


class UnseenSection(
    Section, name="unseen", title="Parameters that are not identifiable", template="unseen.html"
):
    """Parameters that no motion shows, and those that these motions do not show."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Names, and what each is tied to."""
        base, robot = content.identified.base, content.identified.model.robot
        frames = [f"{n}.{b.name}" for n in INERTIAL_NAMES for b in robot.bodies if b.massless]
        return {
            "hidden": [n for k in base.unseen if (n := base.names[k]) not in frames],
            "grouped": [base.names[k] for k in base.dependent],
            "standard": len([name for name in base.names if name not in frames]),
            "base": len(base),
            "blind": content.identified.estimate.blind,
        }


MOST_NAMED_SCATTERS = 3  # in the terminal
LEAST_MARKED_RATIO = 2.0  # ratio of the two standard deviations from which on a row is marked


class BootstrapSection(
    ValueSection, name="bootstrap", title="Bootstrap over time windows", value="bootstrap"
):
    """Stated and drawn standard deviations of every parameter."""

    def tables_of(self, found: Bootstrap, content: ReportContent) -> Sequence[PlainTable]:
        """One row per parameter; those that scatter far more than was stated are marked."""
        return (_bootstrap_table(found, content.identified.estimate.std),)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How the scatter of drawn windows compares with the stated uncertainty."""
        found = content.bootstrap
        if found is None:
            return
        over, names = _ratios(found, content.identified.estimate.std), found.parameters.names
        order = np.argsort(-np.nan_to_num(over))[:MOST_NAMED_SCATTERS]
        most = ", ".join(f"{names[k]} {significant(float(over[k]))}" for k in order)
        lines = [
            f"bootstrap: {len(found.draws)} draws of {count(found.windows, 'window')} scatter by "
            f"{significant(float(np.nanmedian(over)))} of the stated standard deviation in the "
            "median",
            f"largest ratios: {most}; {int(np.sum(over > LEAST_MARKED_RATIO))} of {len(over)} "
            f"above {LEAST_MARKED_RATIO:g}",
        ]
        if found.failed:
            lines.append(f"{count(found.failed, 'draw')} gave no estimate")
        yield Text("\n".join(lines))


def _ratios(found: Bootstrap, stated: Array) -> Array:
    """Scatter of each parameter over its stated standard deviation, shape `(p,)`."""
    unknown = np.full(len(stated), np.nan)
    return np.asarray(np.divide(found.std, stated, out=unknown, where=stated > 0.0))


def _bootstrap_table(found: Bootstrap, stated: Array) -> PlainTable:
    own, over = found.parameters, _ratios(found, stated)
    columns = np.column_stack([own.values, stated, found.std, over, *found.interval()]).tolist()
    rows = [
        Row((name, *map(significant, numbers), unit), bool(ratio > LEAST_MARKED_RATIO))
        for name, unit, numbers, ratio in zip(own.names, own.units, columns, over, strict=True)
    ]
    failed = f" {found.failed} draws gave no estimate." if found.failed else ""
    return PlainTable(
        f"{len(found.draws)} draws of {found.windows} windows",
        "Windows of every run are resampled with replacement, and the whole estimate is repeated."
        f"{failed} Where its scatter exceeds {LEAST_MARKED_RATIO:g} times the stated std (bold), "
        "windows disagree, so the model is incomplete there, or a body lies at the boundary of "
        "physical consistency, where the stated interval is too narrow. Parameters constrained by "
        "the prior scatter less than their uncertainty.",
        ("Parameter", "Value", "Stated std", "Bootstrap std", "Ratio", "2.5 %", "97.5 %", "Unit"),
        rows,
        (0, 7),
    )


REPEATED_TITLE = "Estimates from each log alone"


class RepeatedSection(ValueSection, name="repeated", title=REPEATED_TITLE, value="repeated"):
    """Mean and standard deviation of every parameter over the logs."""

    def tables_of(self, found: RepeatedEstimates, content: ReportContent) -> Sequence[PlainTable]:
        """One row per parameter."""
        return (repeated_table(found),)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The table, as it was asked for."""
        for table in self.tables(content):
            yield text_table(table, self.title)


def repeated_table(found: RepeatedEstimates) -> PlainTable:
    """One row per parameter; a parameter that some estimations do not identify has their number."""
    every = len(found.labels)

    def name(row: Mapping[str, Any]) -> str:
        known: str = row["name"]
        return known if row["count"] == every else f"{known} ({row['count']} of {every})"

    return table_of(
        found.rows(),
        {
            "Parameter": name,
            "Mean": lambda row: significant(row["mean"]),
            "Std": lambda row: significant(row["std"]),
            "Relative": lambda row: percent(row["relative_percent"]),
            "Stated std": lambda row: significant(row["stated_std"]),
            "Unit": lambda row: str(row["unit"]),
        },
        caption=f"{REPEATED_TITLE}: {count(every, 'estimation')}",
        words=f"Mean and {found.deviation} standard deviation over {', '.join(found.labels)}, "
        "beside the root mean square of the stated standard deviations. A prior that all "
        "estimations share reduces their scatter.",
        text=(0, 5),
        note=f"std: {found.deviation}; relative: over the mean; stated std: root mean square of "
        "those stated by the estimations",
    )


MOST_NAMED_MOVES = 10  # parameters that are named: those that move most


class SensitivitySection(
    ValueSection, name="sensitivity", title="Sensitivity to the cut-offs", value="sensitivity"
):
    """Fits with other cut-offs, and the parameters that move most between them."""

    def tables_of(self, found: Sensitivity, content: ReportContent) -> Sequence[PlainTable]:
        """The fits, and the parameters that move most."""
        names, spread = found.parameters.names, found.spread
        moved = table_of(
            np.argsort(-spread)[:MOST_NAMED_MOVES].tolist(),
            {
                "Parameter": lambda k: names[k],
                "Largest shift [std]": lambda k: significant(float(spread[k])),
            },
            caption="Largest parameter shifts",
            words="Largest distance of any of these fits from the result, in standard deviations.",
        )
        return _fits_table(found), moved

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The fits, and which parameters move most between them."""
        found = content.sensitivity
        if found is None:
            return
        yield text_table(_fits_table(found), self.title)
        order = np.argsort(-found.spread)[:MOST_NAMED_MOVES]
        most = ", ".join(f"{found.parameters.names[k]} {found.spread[k]:.1f}" for k in order)
        yield Text(f"largest parameter shifts, in standard deviations: {most}")


def _fits_table(found: Sensitivity) -> PlainTable:
    def shift(fit: Variation) -> str:
        median = found.median_shift(fit)
        return "" if median is None else significant(median)

    return table_of(
        found.rows,
        {
            "Cut-offs": lambda fit: f"x {fit.factor:g}",
            "Motion": lambda fit: f"{fit.motion:g} Hz",
            "Regression": lambda fit: f"{fit.matched:g} Hz",
            "Fit error": lambda fit: fit.failed or _percent(fit.fitted),
            "Validation error": lambda fit: _percent(fit.unseen),
            "Median shift [std]": shift,
        },
        caption="Fits with other cut-offs",
        words="The same laws, nonlinear parameters and gains; errors are of the kind and the band "
        "of the verdict's headline in every row. A result that other cut-offs change by many "
        "standard deviations depends on the choice of cut-offs, not on the data alone.",
        marked=lambda fit: fit is found.result,
    )


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} %"

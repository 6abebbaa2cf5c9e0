"""Sections of the report on conditioning, correlations, and parameters that data do not show."""

from math import hypot

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.estimate import Estimate
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import FigureSection, Numbers, Section, packed
from steelyard.report.page_figures import Figure, Group, row_height, traced
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

MOST_CORRELATED_PAIRS = 6  # most pairs of correlated parameters that are named
LEAST_NAMED_CORRELATION = 0.9  # correlation of two estimates from which on they are named


class ConditioningSection(
    Section, name="conditioning", title="Conditioning", template="conditioning.html"
):
    """Condition numbers, noise per joint, parameters that are hardly distinguished."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Figures of the estimate and of those beside it."""
        estimate = content.identified.estimate
        robot, figures = content.identified.robot, (estimate.sigma, estimate.n_samples)
        noise = zip(
            robot.joint_names, robot.effort_units, *(x.tolist() for x in figures), strict=True
        )
        return {
            "estimate": estimate,
            "others": [
                (other, _furthest(estimate, other)) for other in content.identified.reference
            ],
            "noise": list(noise),
            "pairs": _pairs(estimate),
            "alike": LEAST_NAMED_CORRELATION,
        }


def _furthest(estimate: Estimate, other: Estimate) -> tuple[str, float] | None:
    """The shared parameter that two estimates differ most in, and how far.

    In standard deviations of both together, the root of the sum of their variances: what a prior
    holds in place may lie many of its own away from what the data alone say of it.
    """
    shared = [name for name in estimate.parameters.names if name in other.parameters.names]
    if not shared:
        return None
    mine, others = (
        dict(zip(one.parameters.names, one.std.tolist(), strict=True)) for one in (estimate, other)
    )
    std = {name: hypot(mine[name], others[name]) for name in shared}
    moved = {
        name: abs(other.parameters[name] - estimate.parameters[name]) / std[name]
        for name in shared
        if std[name] > 0.0
    }
    name = max(moved, key=lambda n: moved[n], default=None)
    return None if name is None else (name, moved[name])


def _pairs(estimate: Estimate) -> list[tuple[str, str, float]]:
    """The most correlated pairs of parameters, strongest first; what a bound holds is in none."""
    names, matrix, _ = correlations(estimate, len(estimate.parameters))
    lower = np.tril(matrix, -1)
    order = np.argsort(np.abs(lower), axis=None)[::-1][:MOST_CORRELATED_PAIRS]
    places = [divmod(int(place), len(names)) for place in order]
    return [
        (names[b], names[a], float(lower[a, b]))
        for a, b in places
        if abs(lower[a, b]) >= LEAST_NAMED_CORRELATION
    ]


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

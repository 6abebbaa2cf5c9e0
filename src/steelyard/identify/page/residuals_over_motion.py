"""What the residual depends on: position, speed and effort of the moving joint."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.scores.parts_and_bands_along_run import TorqueParts
from steelyard.identify.page.report_content import ReportContent, unseen_samples
from steelyard.report.page import FigureSection, Numbers, rounded
from steelyard.report.page_figures import Figure, Group, Key, area, evenly, line, points
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import NONE, percent, significant
from steelyard.robot.robot import Coordinate

BINS = 20  # ranges of equal width that a quantity is divided into
LEAST_BIN_SAMPLES = 5  # samples that a bin needs
MOST_RESIDUAL_POINTS = 150  # most points of one figure
RESIDUAL_AXES = ("position", "speed", "effort")  # quantities that the residual is drawn over

RESIDUAL_WORDS = (
    "Mean residual (measured minus predicted effort) of samples with similar position, speed or "
    "measured effort. A complete model has a mean of zero, over effort as far as that is large "
    "against its noise. A trend over position points to masses, springs or cables; over speed to "
    "friction; over effort to drive gains or friction that depends on load."
)


@dataclass(frozen=True, eq=False)
class Binned:
    """The residual of one joint over one quantity; bins with few samples are left out."""

    centre: Array  # of each bin, shape `(k,)`
    mean: Array  # mean residual, shape `(k,)` [Nm; N]
    std: Array  # standard deviation around it, shape `(k,)` [Nm; N]
    share: float  # share of the mean squared residual that the means carry, 0 to 1


def binned(over: Array, residual: Array) -> Binned:
    """Bins of equal width of the residual [Nm; N] over a quantity, both of shape `(N,)`."""
    low, high = (float(over.min()), float(over.max())) if len(over) else (0.0, 0.0)
    width = (high - low) / BINS or 1.0
    place = np.minimum(((over - low) / width).astype(np.intp), BINS - 1)
    count = np.bincount(place, minlength=BINS)
    kept = np.flatnonzero(count >= LEAST_BIN_SAMPLES)
    mean = np.bincount(place, residual, BINS)[kept] / count[kept]
    square = np.bincount(place, residual**2, BINS)[kept] / count[kept]
    total = float(np.sum(residual**2))
    share = float(np.sum(count[kept] * mean**2)) / total if total else 0.0
    std = np.sqrt(np.maximum(square - mean**2, 0.0))
    return Binned(np.linspace(low, high, 2 * BINS + 1)[1::2][kept], mean, std, share)


class ResidualsSection(
    FigureSection, name="residuals", title="Residual over position, speed and effort"
):
    """A table of shares, and three folded figures per joint."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Bins and points."""
        samples = unseen_samples(content)
        if samples is None:
            return None
        parts, runs = samples
        rows, groups = [], []
        for j, joint in enumerate(content.identified.robot.coordinates):
            signals, residual = _moving(parts, j)
            bins = {over: binned(signal, residual) for over, signal in signals.items()}
            rms = float(np.sqrt(np.mean(residual**2))) if len(residual) else None
            shares = [
                percent(100.0 * one.share) if len(one.centre) else NONE for one in bins.values()
            ]
            rows.append(Row((joint.name, significant(rms), joint.effort_unit, *shares)))
            most = max(bins, key=lambda over: bins[over].share)
            caption = f"most over {most}: {percent(100.0 * bins[most].share)}"
            if not any(len(one.centre) for one in bins.values()):
                caption = "too few samples in motion"
            figures = [
                _residual_figure(joint, over, signals[over], residual, bins[over]) for over in bins
            ]
            groups.append(Group(figures, joint.name, caption, "three"))
        shares = [f"Share by {over}" for over in RESIDUAL_AXES]
        headings = ("Joint", "Residual RMS", "Unit", *shares)
        return {
            "words": RESIDUAL_WORDS,
            "tables": [PlainTable("", "", headings, rows, (0, 2))],
            "legend": [
                Key("--residual", "mean residual"),
                Key("--rest", "± one standard deviation", "area"),
                Key("--arm", "samples", "point"),
            ],
            "groups": groups,
            "note": f"Samples of {runs} in which the joint moves, {BINS} bins of equal width with "
            f"at least {LEAST_BIN_SAMPLES} samples each; at most {MOST_RESIDUAL_POINTS} samples "
            "are drawn. Share: part of the mean squared residual that the means of the bins carry; "
            "in a short run some of it is chance.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Shares per joint and quantity."""
        samples = unseen_samples(content)
        if samples is None:
            return {"residual_shares": None}
        found = []
        for j, joint in enumerate(content.identified.joints):
            signals, residual = _moving(samples[0], j)
            shares = {n: rounded(binned(x, residual).share) for n, x in signals.items()}
            found.append({"joint": joint, **shares})
        return {"residual_shares": found}


def _moving(parts: TorqueParts, j: int) -> tuple[dict[str, Array], Array]:
    """The quantities and the residual of the samples in which a joint moves."""
    at = parts.moving[:, j] & np.isfinite(parts.residual[:, j])
    signals = (parts.q, parts.dq, parts.measured)
    return {n: x[at, j] for n, x in zip(RESIDUAL_AXES, signals, strict=True)}, parts.residual[at, j]


def _residual_figure(
    joint: Coordinate, over: str, signal: Array, residual: Array, bins: Binned
) -> Figure:
    at = evenly(len(residual), MOST_RESIDUAL_POINTS)
    units = {"position": joint.unit, "speed": f"{joint.unit}/s", "effort": joint.effort_unit}
    lower, upper = bins.mean - bins.std, bins.mean + bins.std
    traces = [
        area("± std", bins.centre, lower, upper, "--rest"),
        points("samples", signal[at], residual[at], "--arm", 3),
        line("mean", bins.centre, bins.mean, "--residual", width=2.5),
    ]
    label = f"Residual of {joint.name} over {over}"
    x = f"{'measured ' * (over == 'effort')}{over} [{units[over]}]"
    return Figure("", label, x, f"residual [{joint.effort_unit}]", traces, {"showlegend": False})

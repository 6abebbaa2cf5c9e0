"""Efforts of every joint over time, what they consist of, and what the residual depends on."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Z95, Array, stretches
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.gather import Mask
from steelyard.estimate.scores.effort_errors import known_efforts
from steelyard.estimate.scores.parts_and_bands_along_run import PARTS, TorqueParts, Traces
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.page.report_content_and_error_words import (
    ReportContent,
    below,
    pooled_samples,
)
from steelyard.report import page
from steelyard.report import page_figures as plots
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import NONE, percent, significant
from steelyard.robot.robot import Coordinate

MOST_POINTS_OF_EFFORT = 2000  # most points of one line
LEAST_POINTS_OF_EFFORT = 200  # points of one line below which rather a whole run is left out
MOST_POINTS_OF_EFFORTS = 170_000  # points of all lines together: about 1.9 MB of the page
POINTS_OVER_BAND_POINTS = 3  # points of a line over those of the outline of a band, which is smooth
LINES_OF_EFFORT_PLOT = 6  # measured, predicted, difference, three bands
LEAST_COVERAGE_PERCENT = 80.0  # share of the samples [%] in the 95 % band below which it is marked

NOISE_ONLY = "not calibrated: noise only"

MOST_SHADED_RESTS = 80  # most rests that are shaded in one plot


class EffortSection(page.Section, name="effort", title="Effort, measured and predicted"):
    """One plot per joint; a menu chooses the run."""

    def numbers(self, content: ReportContent) -> page.Numbers | None:
        """Lines of every joint and run, unseen runs first."""
        everything = [(s, "repeated motion" if s.repeats else "not fitted") for s in content.scores]
        everything += [(s, "fitted") for s in content.fitted]
        if not everything:
            return None
        lines = LINES_OF_EFFORT_PLOT * max(len(everything[0][0].joints), 1)
        most_runs, n_points = drawn_efforts(lines, len(everything))
        chosen = everything[:most_runs]
        figures = [
            _effort_figure(s, joint, n_points) for s, _ in chosen for joint in range(len(s.joints))
        ]
        return {
            "joints": [joint.joint for joint in chosen[0][0].joints],
            "runs": [f"{score.run} ({kind})" for score, kind in chosen],
            "left_out": [score.run for score, _ in everything[most_runs:]],
            "points": n_points,
            "rests": MOST_SHADED_RESTS,
            "bands": any(figure["bands"] for figure in figures),
            "calibration": band_text(content.identified),
            "basis": basis_of([score for score, _ in chosen], content.identified),
            "few": LEAST_COVERAGE_PERCENT if any(figure["few"] for figure in figures) else None,
            "figures": figures,
        }

    def show(self, numbers: page.Numbers) -> str:
        """The numbers as safe HTML."""
        n_joints = max(len(numbers["joints"]), 1)
        figures = map(page.script_json, numbers["figures"])
        data = [(*divmod(number, n_joints), figure) for number, figure in enumerate(figures)]
        return page.fill("effort.html", {**numbers, "data": data})


def drawn_efforts(lines: int, runs: int) -> tuple[int, int]:
    """How many of some runs with so many lines each are drawn, and with how many points a line."""
    count = min(max(MOST_POINTS_OF_EFFORTS // (lines * LEAST_POINTS_OF_EFFORT), 1), runs)
    n_points = min(MOST_POINTS_OF_EFFORT, MOST_POINTS_OF_EFFORTS // (lines * count))
    return count, max(n_points, LEAST_POINTS_OF_EFFORT)


def band_text(identified: IdentifiedModel) -> str:
    """What the bands of a model's efforts rest on, for people to read."""
    return NOISE_ONLY if identified.calibration is None else identified.calibration.text


def _effort_figure(score: RunScore, joint: int, n_points: int) -> dict[str, Any]:
    """Lines of one joint, caption and shaded rests; time is relative where it is a date."""
    traces, numbers = score.traces, score.joints[joint]
    t, time = plots.from_origin(traces.t)
    measured, predicted = traces.measured[:, joint], traces.predicted[:, joint]
    signals = (measured, predicted, measured - predicted)
    banded = traces.band is not None and bool(np.isfinite(traces.band[:, joint]).any())
    covered = None
    if banded and traces.coverage is not None:
        covered = 100.0 * float(traces.coverage[joint])
    error = score.errors.joints[joint]
    size = f"error {significant(error.error)} {error.unit}"
    used = f"{size}: {percent(error.percent_of_used)} of the effort used"
    still = stretches(~traces.moving[:, joint].astype(bool))
    longest = sorted(((t[a], t[b - 1]) for a, b in still), key=lambda span: span[0] - span[1])
    return {
        "caption": used if error.counted else f"at rest: {size}, not counted",
        "covered": "" if covered is None else f"{percent(covered)} in the 95 % band",
        "few": covered is not None and covered < LEAST_COVERAGE_PERCENT,
        "unit": numbers.unit,
        "time": time,
        "lines": [_packed(plots.drawn(t, signal, n_points)) for signal in signals],
        "bands": _bands(t, traces, joint, n_points) if banded else [],
        "rests": [
            [page.rounded(a), page.rounded(b)] for a, b in sorted(longest[:MOST_SHADED_RESTS])
        ],
    }


def basis_of(scores: Sequence[RunScore], identified: IdentifiedModel) -> str:
    """Unit and band of the lines, and those of the errors above them, where they differ.

    Where known gains lie between the two, one unit, such as Nm, means two efforts.
    """
    units, gains = identified.robot.effort_units, identified.signals.gains
    geared = any(
        x.unit == unit and ok and abs(gain) != 1.0
        for score in scores
        for x, unit, ok, gain in zip(
            score.joints, units, known_efforts(identified), gains, strict=False
        )
    )
    lines, errors = (
        " and ".join(dict.fromkeys(joint.unit for joints in every for joint in joints))
        for every in ([x.joints for x in scores], [x.errors.joints for x in scores])
    )
    shown, judged = below(x.cutoff for x in scores), below(x.errors.cutoff for x in scores)
    if not geared and (lines, shown) == (errors, judged):
        return (
            f"Lines, and the errors above them, which are those of the verdict: {lines}, {shown}."
        )
    fit = "" if shown == judged else ", the validation band"
    joint = " at the joints" if geared or lines != errors else ""
    return (
        f"Lines: efforts in {lines}{' before gains and gears' if geared else ''}, the unit of the "
        f"log, {shown}{fit}. "
        f"Errors above the plots: those of the verdict, in {errors}{joint}, {judged}."
    )


def _bands(t: Array, traces: Traces, joint: int, n_points: int) -> list[dict[str, dict[str, str]]]:
    """Outlines of bands, none without: of a new measurement, of the model, of the residual."""
    if traces.band is None or traces.model_std is None:
        return []
    predicted, half = traces.predicted[:, joint], traces.band[:, joint]
    sure = Z95 * traces.model_std[:, joint]
    sides = ((predicted, half), (predicted, sure), (np.zeros_like(half), half))
    most = max(n_points // POINTS_OVER_BAND_POINTS, LEAST_POINTS_OF_EFFORT)
    return [_packed(plots.outline(t, middle - away, middle + away, most)) for middle, away in sides]


def _packed(pair: tuple[Array, Array]) -> dict[str, dict[str, str]]:
    return {"x": page.packed(pair[0]), "y": page.packed(pair[1])}


MOST_POINTS_OF_TORQUE_PART = 1000  # most points of one line
MOST_POINTS_OF_TORQUE_PARTS = 60_000  # points of all lines together: about 0.6 MB of the page
ROUND_OFF_SHARE = 1e-9  # share of the measured effort below which a part is round-off

TORQUE_PARTS = {  # words, colour and dash
    "gravity": ("gravity", "--purple", "solid"),
    "coriolis": ("Coriolis", "--arm", "dot"),
    "inertia": ("inertia", "--amber", "solid"),
    "friction": ("friction", "--green", "dash"),
    "other": ("springs, offsets", "--soft", "dashdot"),
}


class TorqueSplitSection(page.FigureSection, name="torque-split", title="Effort by cause"):
    """A table of sizes, and one folded figure per joint."""

    def numbers(self, content: ReportContent) -> page.Numbers | None:
        """Parts of one run, one that was not fitted if there is one."""
        found, joints = _run(content), content.identified.robot.coordinates
        if found is None:
            return None
        score, kind, parts = found
        sizes = _sizes(parts, parts.moving)
        rows, captions = [], []
        for j, joint in enumerate(joints):
            own = {name: float(size[j]) for name, size in sizes.items()}
            cells = (significant(x, 3) for x in own.values())
            rows.append(Row((joint.name, *cells, joint.effort_unit)))
            largest = sorted(PARTS, key=lambda name: -own[name])[:2]
            sizes_of = ((TORQUE_PARTS[x][0], significant(own[x], 2)) for x in largest)
            words = (f"{part} {size} {joint.effort_unit}" for part, size in sizes_of)
            captions.append(f"mostly {', '.join(words)}")
        names = [TORQUE_PARTS.get(name, (name,))[0] for name in sizes]
        headings = ("Joint", *(name[0].upper() + name[1:] for name in names), "Unit")
        left = (0, len(headings) - 1)
        present = _sizes(parts, np.ones_like(parts.moving))
        share = MOST_POINTS_OF_TORQUE_PARTS // ((2 + len(PARTS)) * len(joints))
        n_points = min(MOST_POINTS_OF_TORQUE_PART, share)
        figures = [_torque_figure(parts, j, x, present, n_points) for j, x in enumerate(joints)]
        groups = [
            plots.Group([figure], joint.name, caption, "one")
            for figure, joint, caption in zip(figures, joints, captions, strict=True)
        ]
        return {
            "words": f"Run {score.run} ({kind}). Efforts at the joints below {score.cutoff:g} Hz, "
            "the validation band; the parts add up to the predicted effort. Root mean squares are "
            "of the samples in which the joint moves; of all samples if it rests throughout.",
            "tables": [PlainTable("Root mean squares", "", headings, rows, left)],
            "groups": groups,
            "note": "Coriolis: with centrifugal efforts. Inertia: mass matrix times acceleration, "
            "with rotors. A part that is small throughout is hardly identifiable from this motion. "
            f"Each line has at most {n_points} evenly spaced points. Click an entry of a legend to "
            "hide it.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """RMS of the parts per joint, where it moves."""
        if (found := _run(content)) is None:
            return {"torque_split": None}
        score, _, parts = found
        sizes = _sizes(parts, parts.moving)
        joints = [
            {"joint": joint, **{name: page.rounded(size[j]) for name, size in sizes.items()}}
            for j, joint in enumerate(content.identified.joints)
        ]
        return {"torque_split": {"run": score.run, "joints": joints}}


def _run(content: ReportContent) -> tuple[RunScore, str, TorqueParts] | None:
    """The first run with parts, and its kind; those that were not fitted come first."""
    for kind, scores in (("not fitted", content.scores), ("fitted", content.fitted)):
        for score in scores:
            if score.parts is not None:
                return score, kind, score.parts
    return None


def _sizes(parts: TorqueParts, chosen: Mask) -> dict[str, Array]:
    """RMS per joint of each part, of measured effort and residual, `(n,)`, over chosen `(N, n)`."""
    weights = np.where(chosen.any(axis=0), chosen, True)
    signals = dict(zip(PARTS, parts.parts, strict=True))
    signals |= {"measured": parts.measured, "residual": parts.residual}
    squares = {n: np.average(np.square(x), axis=0, weights=weights) for n, x in signals.items()}
    sizes = {name: np.sqrt(square) for name, square in squares.items()}
    least = ROUND_OFF_SHARE * sizes["measured"]
    return {name: np.where(size <= least, 0.0, size) for name, size in sizes.items()}


def _torque_figure(
    parts: TorqueParts, j: int, joint: Coordinate, present: dict[str, Array], n_points: int
) -> plots.Figure:
    """Measured and predicted effort above, the parts below; those that are zero are left out."""
    breaks = plots.gaps(parts.t)[: n_points // 4]
    every = np.arange(len(parts.t))[plots.evenly(len(parts.t), n_points - len(breaks))]
    places = np.searchsorted(every, breaks, side="right")
    at, t = np.insert(every, places, -1), np.insert(parts.t[every], places, np.nan)
    hover = f"%{{y:.3g}} {joint.effort_unit}"

    def trace(name: str, signal: Array, **more: Any) -> dict[str, Any]:
        return plots.line(
            name, t, np.where(at < 0, np.nan, signal[at]), hovertemplate=hover, **more
        )

    traces = [
        trace("measured", parts.measured[:, j], colour="--measured", width=4.2),
        trace("predicted", parts.predicted[:, j], colour="--predicted", width=1.6, dash="8px,5px"),
    ]
    for name, part in zip(PARTS, parts.parts, strict=True):
        if present[name][j]:
            words, colour, dash = TORQUE_PARTS[name]
            traces.append(trace(words, part[:, j], colour=colour, width=1.8, dash=dash, yaxis="y2"))
    title = {"text": joint.effort_unit, "standoff": 4}
    layout = {
        "hovermode": "x unified",
        "xaxis": {"anchor": "y2"},
        "yaxis": {"domain": [0.6, 1.0]},
        "yaxis2": {"domain": [0.0, 0.52], "title": title, "zeroline": True},
    }
    label = f"Effort of {joint.name} by cause over time"
    return plots.Figure("", label, "time [s]", joint.effort_unit, traces, layout, height=460)


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
    page.FigureSection, name="residuals", title="Residual over position, speed and effort"
):
    """A table of shares, and three folded figures per joint."""

    def numbers(self, content: ReportContent) -> page.Numbers | None:
        """Bins and points."""
        samples = pooled_samples(content, "validation")
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
            figures = [_residual_figure(joint, x, signals[x], residual, bins[x]) for x in bins]
            groups.append(plots.Group(figures, joint.name, caption, "three"))
        headings = ("Joint", "Residual RMS", "Unit", *(f"Share by {x}" for x in RESIDUAL_AXES))
        return {
            "words": RESIDUAL_WORDS,
            "tables": [PlainTable("", "", headings, rows, (0, 2))],
            "legend": [
                plots.Key("--residual", "mean residual"),
                plots.Key("--rest", "± one standard deviation", "area"),
                plots.Key("--arm", "samples", "point"),
            ],
            "groups": groups,
            "note": f"Samples of {runs} in which the joint moves, {BINS} bins of equal width with "
            f"at least {LEAST_BIN_SAMPLES} samples each; at most {MOST_RESIDUAL_POINTS} samples "
            "are drawn. Share: part of the mean squared residual that the means of the bins carry; "
            "in a short run some of it is chance.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Shares per joint and quantity."""
        samples = pooled_samples(content, "validation")
        if samples is None:
            return {"residual_shares": None}
        found = []
        for j, joint in enumerate(content.identified.joints):
            signals, residual = _moving(samples[0], j)
            shares = {n: page.rounded(binned(x, residual).share) for n, x in signals.items()}
            found.append({"joint": joint, **shares})
        return {"residual_shares": found}


def _moving(parts: TorqueParts, j: int) -> tuple[dict[str, Array], Array]:
    """The quantities and the residual of the samples in which a joint moves."""
    at = parts.moving[:, j] & np.isfinite(parts.residual[:, j])
    signals = (parts.q, parts.dq, parts.measured)
    return {n: x[at, j] for n, x in zip(RESIDUAL_AXES, signals, strict=True)}, parts.residual[at, j]


def _residual_figure(
    joint: Coordinate, over: str, signal: Array, residual: Array, bins: Binned
) -> plots.Figure:
    at = plots.evenly(len(residual), MOST_RESIDUAL_POINTS)
    units = {"position": joint.unit, "speed": f"{joint.unit}/s", "effort": joint.effort_unit}
    lower, upper = bins.mean - bins.std, bins.mean + bins.std
    traces = [
        plots.area("± std", bins.centre, lower, upper, "--rest"),
        plots.points("samples", signal[at], residual[at], "--arm", 3),
        plots.line("mean", bins.centre, bins.mean, "--residual", width=2.5),
    ]
    label = f"Residual of {joint.name} over {over}"
    x = f"{'measured ' * (over == 'effort')}{over} [{units[over]}]"
    return plots.Figure(
        "", label, x, f"residual [{joint.effort_unit}]", traces, {"showlegend": False}
    )

"""Measured and predicted effort of every joint over time, and what the prediction consists of."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.gather import Mask
from steelyard.estimate.scores.effort_errors import known_efforts
from steelyard.estimate.scores.parts_and_bands_along_run import PARTS, TorqueParts, Traces
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.page.effort_error_words import below
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import (
    FigureSection,
    Numbers,
    Section,
    fill,
    packed,
    rounded,
    script_json,
)
from steelyard.report.page_figures import Figure, Group, drawn, from_origin, gaps, line, outline
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import percent, significant
from steelyard.robot.robot import Coordinate

MOST_POINTS_OF_EFFORT = 2000  # most points of one line
LEAST_POINTS_OF_EFFORT = 200  # points of one line below which rather a whole run is left out
MOST_POINTS_OF_EFFORTS = 170_000  # points of all lines together: about 1.9 MB of the page
POINTS_OVER_BAND_POINTS = 3  # points of a line over those of the outline of a band, which is smooth
LINES_OF_EFFORT_PLOT = 6  # measured, predicted, difference, three bands
LEAST_COVERAGE_PERCENT = 80.0  # share of the samples [%] in the 95 % band below which it is marked

NOISE_ONLY = "not calibrated: noise only"

MOST_SHADED_RESTS = 80  # most rests that are shaded in one plot


class EffortSection(Section, name="effort", title="Effort, measured and predicted"):
    """One plot per joint; a menu chooses the run."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Lines of every joint and run, unseen runs first."""
        everything = [(s, "repeated motion" if s.repeats else "not fitted") for s in content.scores]
        everything += [(s, "fitted") for s in content.fitted]
        if not everything:
            return None
        lines = LINES_OF_EFFORT_PLOT * max(len(everything[0][0].joints), 1)
        most_runs, points = drawn_efforts(lines, len(everything))
        chosen = everything[:most_runs]
        figures = [
            _effort_figure(s, joint, points) for s, _ in chosen for joint in range(len(s.joints))
        ]
        return {
            "joints": [joint.joint for joint in chosen[0][0].joints],
            "runs": [f"{score.run} ({kind})" for score, kind in chosen],
            "left_out": [score.run for score, _ in everything[most_runs:]],
            "points": points,
            "rests": MOST_SHADED_RESTS,
            "bands": any(figure["bands"] for figure in figures),
            "calibration": band_text(content.identified),
            "basis": basis_of([score for score, _ in chosen], content.identified),
            "few": LEAST_COVERAGE_PERCENT if any(figure["few"] for figure in figures) else None,
            "figures": figures,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        n_joints = max(len(numbers["joints"]), 1)
        data = [
            (index // n_joints, index % n_joints, script_json(figure))
            for index, figure in enumerate(numbers["figures"])
        ]
        return fill("effort.html", {**numbers, "data": data})


def drawn_efforts(lines: int, runs: int) -> tuple[int, int]:
    """How many of some runs with so many lines each are drawn, and with how many points a line."""
    count = min(max(MOST_POINTS_OF_EFFORTS // (lines * LEAST_POINTS_OF_EFFORT), 1), runs)
    points = min(MOST_POINTS_OF_EFFORT, MOST_POINTS_OF_EFFORTS // (lines * count))
    return count, max(points, LEAST_POINTS_OF_EFFORT)


def band_text(identified: IdentifiedModel) -> str:
    """What the bands of a model's efforts rest on, for people to read."""
    return NOISE_ONLY if identified.calibration is None else identified.calibration.text


def _effort_figure(score: RunScore, joint: int, points: int) -> dict[str, Any]:
    """Lines of one joint, caption and shaded rests; time is relative where it is a date."""
    traces, numbers = score.traces, score.joints[joint]
    t, time = from_origin(traces.t)
    measured, predicted = traces.measured[:, joint], traces.predicted[:, joint]
    signals = (measured, predicted, measured - predicted)
    banded = traces.band is not None and bool(np.isfinite(traces.band[:, joint]).any())
    covered = None
    if banded and traces.coverage is not None:
        covered = 100.0 * float(traces.coverage[joint])
    error = score.errors.joints[joint]
    size = f"error {significant(error.error)} {error.unit}"
    used = f"{size}: {percent(error.percent_of_used)} of the effort used"
    return {
        "caption": used if error.counted else f"at rest: {size}, not counted",
        "covered": "" if covered is None else f"{percent(covered)} in the 95 % band",
        "few": covered is not None and covered < LEAST_COVERAGE_PERCENT,
        "unit": numbers.unit,
        "time": time,
        "lines": [_packed(drawn(t, signal, points)) for signal in signals],
        "bands": _bands(t, traces, joint, points) if banded else [],
        "rests": _rests(t, traces, joint),
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
    drawn, judged = below(x.cutoff for x in scores), below(x.errors.cutoff for x in scores)
    if not geared and (lines, drawn) == (errors, judged):
        return (
            f"Lines, and the errors above them, which are those of the verdict: {lines}, {drawn}."
        )
    fit = "" if drawn == judged else ", the validation band"
    joint = " at the joints" if geared or lines != errors else ""
    return (
        f"Lines: efforts in {lines}{' before gains and gears' if geared else ''}, the unit of the "
        f"log, {drawn}{fit}. "
        f"Errors above the plots: those of the verdict, in {errors}{joint}, {judged}."
    )


def _bands(t: Array, traces: Traces, joint: int, points: int) -> list[dict[str, dict[str, str]]]:
    """Outlines of bands, none without: of a new measurement, of the model, of the residual."""
    if traces.band is None or traces.model_std is None:
        return []
    predicted, half = traces.predicted[:, joint], traces.band[:, joint]
    sure = Z95 * traces.model_std[:, joint]
    sides = ((predicted, half), (predicted, sure), (np.zeros_like(half), half))
    most = max(points // POINTS_OVER_BAND_POINTS, LEAST_POINTS_OF_EFFORT)
    return [_packed(outline(t, middle - away, middle + away, most)) for middle, away in sides]


def _packed(points: tuple[Array, Array]) -> dict[str, dict[str, str]]:
    return {"x": packed(points[0]), "y": packed(points[1])}


def _rests(t: Array, traces: Traces, joint: int) -> list[list[float | None]]:
    """Start and end [s] of the longest stretches in which the joint does not move."""
    still = np.concatenate([[False], ~traces.moving[:, joint].astype(bool), [False]])
    edges = np.flatnonzero(np.diff(still))
    spans = [(float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    spans.sort(key=lambda span: span[0] - span[1])
    return [[rounded(a), rounded(b)] for a, b in sorted(spans[:MOST_SHADED_RESTS])]


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


class TorqueSplitSection(FigureSection, name="torque-split", title="Effort by cause"):
    """A table of sizes, and one folded figure per joint."""

    def numbers(self, content: ReportContent) -> Numbers | None:
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
            words = (
                f"{TORQUE_PARTS[x][0]} {significant(own[x], 2)} {joint.effort_unit}"
                for x in largest
            )
            captions.append(f"mostly {', '.join(words)}")
        names = [TORQUE_PARTS.get(name, (name,))[0] for name in sizes]
        headings = ("Joint", *(name[0].upper() + name[1:] for name in names), "Unit")
        left = (0, len(headings) - 1)
        present = _sizes(parts, np.ones_like(parts.moving))
        points = min(
            MOST_POINTS_OF_TORQUE_PART,
            MOST_POINTS_OF_TORQUE_PARTS // ((2 + len(PARTS)) * len(joints)),
        )
        groups = [
            Group(
                [_torque_figure(parts, j, joint, present, points)], joint.name, captions[j], "one"
            )
            for j, joint in enumerate(joints)
        ]
        return {
            "words": f"Run {score.run} ({kind}). Efforts at the joints below {score.cutoff:g} Hz, "
            "the validation band; the parts add up to the predicted effort. Root mean squares are "
            "of the samples in which the joint moves; of all samples if it rests throughout.",
            "tables": [PlainTable("Root mean squares", "", headings, rows, left)],
            "groups": groups,
            "note": "Coriolis: with centrifugal efforts. Inertia: mass matrix times acceleration, "
            "with rotors. A part that is small throughout is hardly identifiable from this motion. "
            f"Each line has at most {points} evenly spaced points. Click an entry of a legend to "
            "hide it.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """RMS of the parts per joint, where it moves."""
        if (found := _run(content)) is None:
            return {"torque_split": None}
        score, _, parts = found
        sizes = _sizes(parts, parts.moving)
        joints = [
            {"joint": joint, **{name: rounded(size[j]) for name, size in sizes.items()}}
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
    sizes = {
        name: np.sqrt(np.average(np.square(x), axis=0, weights=weights))
        for name, x in signals.items()
    }
    least = ROUND_OFF_SHARE * sizes["measured"]
    return {name: np.where(size <= least, 0.0, size) for name, size in sizes.items()}


def _torque_figure(
    parts: TorqueParts, j: int, joint: Coordinate, present: dict[str, Array], points: int
) -> Figure:
    """Measured and predicted effort above, the parts below; those that are zero are left out."""
    at, t = _drawn(parts.t, points)
    hover = f"%{{y:.3g}} {joint.effort_unit}"

    def trace(name: str, signal: Array, **more: Any) -> dict[str, Any]:
        return line(name, t, np.where(at < 0, np.nan, signal[at]), hovertemplate=hover, **more)

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
    return Figure("", label, "time [s]", joint.effort_unit, traces, layout, height=460)


def _drawn(t: Array, points: int) -> tuple[Array, Array]:
    """Indices of the samples to draw, -1 at a gap of time, and their times, `(points,)` at most."""
    breaks = gaps(t)[: points // 4]
    step = max(1, -(-len(t) // (points - len(breaks))))
    at = np.arange(0, len(t), step)
    places = np.searchsorted(at, breaks, side="right")
    return np.insert(at, places, -1), np.insert(t[at], places, np.nan)

"""Measured and predicted effort of every joint, with residuals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Z95
from steelyard.report.content import ReportContent
from steelyard.report.html import fill, packed, rounded, script_json
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.score_words import below
from steelyard.report.text.words import percent, significant
from steelyard.report.thin import drawn, outline

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel
    from steelyard.validation.score import RunScore
    from steelyard.validation.traces import Traces

POINTS = 2000
"""Most points of one line."""

FEWEST = 200
"""Points of one line below which rather a whole run is left out."""

BUDGET = 170_000
"""Points of all lines together: about 1.9 MB of the page."""

COARSER = 3
"""Points of a line over those of the outline of a band, which is smooth."""

DRAWN = 6
"""Lines and outlines of a plot: measured, predicted, their difference, three bands."""

FEW = 80.0
"""Share of the samples [%] in the 95 % band below which it is marked."""

NOISE_ONLY = "not calibrated: noise only"

RESTS = 80
"""Most rests that are shaded in one plot."""


class EffortSection(Section):
    """One plot per joint; a menu chooses the run."""

    name: ClassVar[str] = "effort"
    title: ClassVar[str] = "Effort, measured and predicted"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Lines of every joint and run, unseen runs first."""
        everything = [(s, "repeated motion" if s.repeats else "not fitted") for s in content.scores]
        everything += [(s, "fitted") for s in content.fitted]
        if not everything:
            return None
        n_joints = max(len(everything[0][0].joints), 1)
        most_runs = max(BUDGET // (DRAWN * n_joints * FEWEST), 1)
        chosen = everything[:most_runs]
        points = min(POINTS, BUDGET // (DRAWN * n_joints * len(chosen)))
        figures = [_figure(s, joint, points) for s, _ in chosen for joint in range(len(s.joints))]
        return {
            "joints": [joint.joint for joint in chosen[0][0].joints],
            "runs": [f"{score.run} ({kind})" for score, kind in chosen],
            "left_out": [score.run for score, _ in everything[most_runs:]],
            "points": points,
            "rests": RESTS,
            "bands": any(figure["bands"] for figure in figures),
            "calibration": band_text(content.identified),
            "basis": basis_of([score for score, _ in chosen]),
            "few": FEW if any(figure["few"] for figure in figures) else None,
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


def band_text(identified: IdentifiedModel | None) -> str:
    """What the bands of a model's efforts rest on, for people to read."""
    calibration = None if identified is None else identified.calibration
    return NOISE_ONLY if calibration is None else calibration.text


def _figure(score: RunScore, joint: int, points: int) -> dict[str, Any]:
    """Lines of one joint, caption and shaded rests; time is relative where it is a date."""
    traces, numbers = score.traces, score.joints[joint]
    origin = float(traces.t[0]) if len(traces.t) and abs(traces.t[-1]) > 1e5 else 0.0
    t = traces.t - origin
    measured, predicted = traces.measured[:, joint], traces.predicted[:, joint]
    covered = _covered(traces, joint)
    return {
        "caption": _caption(score, joint),
        "covered": "" if covered is None else f"{percent(covered)} in the 95 % band",
        "few": covered is not None and covered < FEW,
        "unit": numbers.unit,
        "time": f"time from {origin:.3f} s [s]" if origin else "time [s]",
        "lines": [
            _line(t, signal, points) for signal in (measured, predicted, measured - predicted)
        ],
        "bands": _bands(t, traces, joint, points),
        "rests": _rests(t, traces, joint),
    }


def basis_of(scores: Sequence[RunScore]) -> str:
    """Unit and band of the lines, and those of the errors above them, where they differ."""
    lines = _units(joint.unit for score in scores for joint in score.joints)
    errors = _units(joint.unit for score in scores for joint in score.errors.joints)
    drawn, judged = below(x.cutoff for x in scores), below(x.errors.cutoff for x in scores)
    if (lines, drawn) == (errors, judged):
        return (
            f"Lines, and the errors above them, which are those of the verdict: {lines}, {drawn}."
        )
    fit = "" if drawn == judged else ", the validation band"
    joint = "" if lines == errors else " at the joints"
    return (
        f"Lines: efforts in {lines}, the unit of the log, {drawn}{fit}. "
        f"Errors above the plots: those of the verdict, in {errors}{joint}, {judged}."
    )


def _units(units: Iterable[str]) -> str:
    return " and ".join(dict.fromkeys(units))


def _caption(score: RunScore, joint: int) -> str:
    """The error of a joint in the verdict."""
    found = score.errors.joints[joint]
    size = f"error {significant(found.error)} {found.unit}"
    if not found.counted:
        return f"at rest: {size}, not counted"
    return f"{size}: {percent(found.percent_of_used)} of the effort used"


def _covered(traces: Traces, joint: int) -> float | None:
    """The share of the measured effort that lies in the band [%]."""
    if not _banded(traces, joint) or traces.coverage is None:
        return None
    return 100.0 * float(traces.coverage[joint])


def _banded(traces: Traces, joint: int) -> bool:
    """Whether a joint has a band; one that never moved while fitting has none."""
    return traces.band is not None and bool(np.isfinite(traces.band[:, joint]).any())


def _bands(t: Array, traces: Traces, joint: int, points: int) -> list[dict[str, dict[str, str]]]:
    """Outlines of bands, none without: of a new measurement, of the model, of the residual."""
    if not _banded(traces, joint) or traces.band is None or traces.model_std is None:
        return []
    predicted, half = traces.predicted[:, joint], traces.band[:, joint]
    sure = Z95 * traces.model_std[:, joint]
    sides = ((predicted, half), (predicted, sure), (np.zeros_like(half), half))
    most = max(points // COARSER, FEWEST)
    outlines = [outline(t, middle - away, middle + away, most) for middle, away in sides]
    return [{"x": packed(x), "y": packed(y)} for x, y in outlines]


def _line(t: Array, signal: Array, points: int) -> dict[str, dict[str, str]]:
    x, y = drawn(t, signal, points)
    return {"x": packed(x), "y": packed(y)}


def _rests(t: Array, traces: Traces, joint: int) -> list[list[float | None]]:
    """Start and end [s] of the longest stretches in which the joint does not move."""
    still = np.concatenate([[False], ~traces.moving[:, joint].astype(bool), [False]])
    edges = np.flatnonzero(np.diff(still))
    spans = [(float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    spans.sort(key=lambda span: span[0] - span[1])
    return [[rounded(a), rounded(b)] for a, b in sorted(spans[:RESTS])]

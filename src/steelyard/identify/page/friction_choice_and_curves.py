"""How friction laws were chosen, and friction over speed."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import json_values
from steelyard.estimate.friction.friction_choice import FrictionChoice
from steelyard.estimate.friction.friction_mixes_and_curves import FrictionCurve, friction_curves
from steelyard.estimate.nonlinear.nonlinear_parameters import Finding
from steelyard.estimate.scores.parts_and_bands_along_run import PARTS, TorqueParts
from steelyard.identify.page.report_content_and_error_words import ReportContent, pooled_samples
from steelyard.model.terms.term import StatefulTerm
from steelyard.report.page import FigureSection, Numbers, TableSection, rounded
from steelyard.report.page_figures import Figure, Group, Key, area, evenly, line, points
from steelyard.report.tables import PlainTable, Row, table_of
from steelyard.report.words import count, significant
from steelyard.robot.robot import Coordinate

FRICTION_ERROR_WORDS = (
    "geometric mean of two errors, that of all joints together and the geometric mean over joints, "
    "after the parallel filter; not comparable with the verdict"
)
ONE_CURVE = (
    "Their coefficients describe one friction curve per joint together and are valid only "
    "together: quote the curve (report), not a coefficient"
)


class FrictionSection(TableSection, name="friction", title="Friction", in_terminal=True):
    """The mixes that were compared, and the fields that were found."""

    def tables(self, content: Any) -> list[PlainTable]:
        """One table each, if there is anything in it."""
        tables = [] if content.friction is None else [_mixes(content.friction)]
        if content.findings:
            tables.append(_fields(content.findings))
        return tables

    def printed(self, content: Any) -> Iterable[RenderableType]:
        """The laws that were chosen, and how much of the error they take away."""
        if content.friction is not None:
            yield Text(_chosen(content.friction))

    def detailed(self, content: Any) -> Iterable[RenderableType]:
        """The tables; laws for controllers that keep no state, where the chosen ones need one."""
        yield from super().detailed(content)
        if content.friction is not None and (other := without_memory(content.friction)):
            yield Text(other)
        if content.friction is None and isinstance(content, ReportContent):
            terms = content.identified.model.terms
            laws = [term.law for term in terms if isinstance(term, StatefulTerm)]
            if laws:
                yield Text(
                    f"friction laws with memory ({', '.join(laws)}): for controllers that keep no "
                    "state between samples choose laws without memory; friction = "
                    '"auto" compares them'
                )

    def to_dict(self, content: Any) -> dict[str, Any]:
        """The choice of laws, and the fields."""
        return {
            "friction": None if content.friction is None else content.friction.to_dict(),
            "fields": json_values(content.findings),
        }


def _chosen(choice: FrictionChoice) -> str:
    first, best = choice.table[0], choice.best
    compared = f"{count(len(choice.table), 'combination')} of laws compared"
    if best is first:
        return f"friction laws: {best.name} ({compared}, none is significantly better)"
    return (
        f"friction laws: {best.name} ({compared}; error on motion left out {best.error:.2f} %, "
        f"with {first.name} {first.error:.2f} %). {ONE_CURVE}"
    )


def without_memory(choice: FrictionChoice) -> str:
    """The laws for a controller that keeps no state; empty if the chosen ones need none."""
    other = choice.without_memory
    if other is None:
        return ""
    more = 100.0 * (other.error / choice.best.error - 1.0)
    return (
        'for controllers that keep no state between samples: friction = "auto_memoryless", laws '
        f"without memory such as {other.name} (error on motion left out {abs(more):.0f} % "
        f"{'larger' if more >= 0.0 else 'smaller'} in this comparison)"
    )


def _mixes(choice: FrictionChoice) -> PlainTable:
    rows = []
    for mix in choice.table:
        numbers = f"{mix.error:.2f} %", f"{mix.gain:.1f} %", f"± {mix.spread:.1f} %"
        rows.append(Row((mix.name, *numbers, "chosen" if mix.chosen else ""), mix.chosen))
    other, said = without_memory(choice), _chosen(choice)
    return PlainTable(
        "Friction laws compared",
        f"Cross-validation: each {choice.left_out} is predicted by a fit to all others. Error: "
        f"{FRICTION_ERROR_WORDS}; improvement relative to the first row, with its standard error. "
        "A simpler combination is preferred unless the improvement by a better one is significant. "
        "Speeds are in rad/s, lengths in rad (prismatic joints: m/s, m)."
        + (f" {other[0].upper()}{other[1:]}." if other else ""),
        ("Friction laws", "Error", "Improvement", "Standard error", ""),
        rows,
        (0, 4),
        f"cross-validation, leaving out one {choice.left_out} at a time; error: "
        f"{FRICTION_ERROR_WORDS}",
        f"{said[0].upper()}{said[1:]}",
    )


def _fields(findings: tuple[Finding, ...]) -> PlainTable:
    return table_of(
        findings,
        {
            "Term": lambda one: one.term,
            "Parameter": lambda one: one.field,
            "Joint": lambda one: one.joint or "all",
            "Value": lambda one: significant(one.value),
            "Interval": lambda one: " to ".join(map(significant, one.interval)),
            "": lambda one: "" if one.identifiable else "not identifiable",
        },
        caption="Estimated nonlinear parameters",
        words="Parameters in which the torque is nonlinear, with 95 % intervals, cut at the bounds "
        "of the search.",
        text=(0, 1, 2, 5),
    )


MOST_FRICTION_POINTS = 400  # most points of one joint

FRICTION_CURVE_WORDS = (
    "Curve: friction of the model while the joint moves at constant speed. Points: measured effort "
    "minus everything else in the model. Points leave the curve near zero speed where the friction "
    "law depends on the motion before, and at any speed where it depends on the load. Otherwise "
    "they show what it lacks: a bend near zero speed, a curvature, a difference between the "
    "directions."
)


class FrictionCurvesSection(FigureSection, name="friction-curves", title="Friction over speed"):
    """One figure per joint whose friction was identified."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Curves and points."""
        found, samples = curves_of(content), pooled_samples(content, "fitted")
        if samples is None or not found:
            return None
        parts, runs = samples
        robot = content.identified.model.robot
        places = [robot.joint_names.index(curve.joint) for curve in found]
        figures = [
            _curve_figure(curve, robot.coordinates[j], j, parts)
            for j, curve in zip(places, found, strict=True)
        ]
        cutoff = content.identified.cutoffs.score
        return {
            "words": FRICTION_CURVE_WORDS,
            "legend": [
                Key("--measured", "measured effort without the rest of the model", "point"),
                Key("--predicted", "friction of the model"),
                Key("--surely", "95 % interval, from the errors of the parameters", "area"),
            ],
            "groups": [Group(figures)],
            "note": f"Points: at most {MOST_FRICTION_POINTS} evenly spaced samples of {runs} in "
            f"which the joint moves, low-passed at {cutoff:g} Hz, the validation band; that rounds "
            "off steps at zero speed. Friction that depends on load is drawn at the sample of "
            "median gravity load. The curve is that of a joint that moves alone: where friction "
            "couples joints, points lie beside it.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The curves."""
        return {
            "friction_curves": [
                {
                    "joint": curve.joint,
                    "speed": list(map(rounded, curve.speed)),
                    "friction": list(map(rounded, curve.effort)),
                    "half_width": list(map(rounded, curve.half_width)),
                }
                for curve in curves_of(content)
            ]
        }


def curves_of(content: ReportContent) -> tuple[FrictionCurve, ...]:
    """The curves up to the largest speed in the samples; none without samples."""
    samples = pooled_samples(content, "fitted")
    if samples is None:
        return ()
    parts, _ = samples
    load = np.abs(parts.parts[PARTS.index("gravity")])
    median = np.argsort(load, axis=0)[len(load) // 2]
    fastest = np.abs(np.where(parts.moving, parts.dq, 0.0)).max(axis=0)
    return friction_curves(content.identified, parts.q[median], fastest)


def _curve_figure(curve: FrictionCurve, joint: Coordinate, j: int, parts: TorqueParts) -> Figure:
    moving = np.flatnonzero(parts.moving[:, j])
    chosen = moving[evenly(len(moving), MOST_FRICTION_POINTS)]
    speed, half = curve.speed, curve.half_width
    middle = len(speed) // 2
    sides = (slice(None, middle), slice(middle, None))
    # Later traces are drawn over earlier ones: the band must not hide the points.
    lower, upper = curve.effort - half, curve.effort + half
    hover = f"%{{x:.3g}} {joint.unit}/s: %{{y:.3g}} {joint.effort_unit}<extra></extra>"
    traces = [
        *(area("95 % interval", speed[at], lower[at], upper[at], "--surely", 0.7) for at in sides),
        points("measured", parts.dq[chosen, j], parts.friction[chosen, j], "--measured", 4),
        line("friction", speed, curve.effort, "--predicted", width=2.5, hovertemplate=hover),
    ]
    label = f"Friction of {curve.joint} over its speed, with samples"
    axes = f"speed [{joint.unit}/s]", f"friction [{joint.effort_unit}]"
    return Figure(curve.joint, label, *axes, traces, {"showlegend": False})

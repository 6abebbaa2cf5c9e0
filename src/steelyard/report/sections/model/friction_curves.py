"""The identified friction of every joint over its speed, with the samples behind it."""

from typing import Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, Key, area, evenly, line, points
from steelyard.report.html import rounded
from steelyard.report.parts import fitted_samples
from steelyard.report.sections.section import FigureSection, Numbers
from steelyard.robot.robot import Coordinate
from steelyard.validation.friction_curves import FrictionCurve, friction_curves
from steelyard.validation.torque_parts import PARTS, TorqueParts

POINTS = 400
"""Most points of one joint."""

WORDS = (
    "Curve: friction of the model while the joint moves at constant speed. Points: measured effort "
    "minus everything else in the model. Points leave the curve near zero speed where the friction "
    "law depends on the motion before, and at any speed where it depends on the load. Otherwise "
    "they show what it lacks: a bend near zero speed, a curvature, a difference between the "
    "directions."
)


class FrictionCurvesSection(FigureSection):
    """One figure per joint whose friction was identified."""

    name: ClassVar[str] = "friction-curves"
    title: ClassVar[str] = "Friction over speed"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Curves and points."""
        found, samples = curves_of(content), fitted_samples(content)
        if content.identified is None or samples is None or not found:
            return None
        parts, runs = samples
        robot = content.identified.model.robot
        figures = [
            _figure(curve, robot.coordinates[robot.joint_names.index(curve.joint)], j, parts)
            for j, curve in ((robot.joint_names.index(c.joint), c) for c in found)
        ]
        cutoff = content.identified.cutoffs.score
        return {
            "words": WORDS,
            "legend": [
                Key("--measured", "measured effort without the rest of the model", "point"),
                Key("--predicted", "friction of the model"),
                Key("--surely", "95 % interval, from the errors of the parameters", "area"),
            ],
            "groups": [Group(figures)],
            "note": f"Points: at most {POINTS} evenly spaced samples of {runs} in which the joint "
            f"moves, low-passed at {cutoff:g} Hz, the validation band; that rounds off steps "
            "at zero speed. Friction "
            "that depends on load is drawn at the sample of median gravity load. The curve is that "
            "of a joint that moves alone: where friction couples joints, points lie beside it.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The curves."""
        return {"friction_curves": [_curve_dict(curve) for curve in curves_of(content)]}


def curves_of(content: ReportContent) -> tuple[FrictionCurve, ...]:
    """The curves up to the largest speed in the samples; none without samples."""
    samples = fitted_samples(content)
    if content.identified is None or samples is None:
        return ()
    parts, _ = samples
    load = np.abs(parts.parts[PARTS.index("gravity")])
    median = np.argsort(load, axis=0)[len(load) // 2]
    fastest = np.abs(np.where(parts.moving, parts.dq, 0.0)).max(axis=0)
    return friction_curves(content.identified, parts.q[median], fastest)


def _figure(curve: FrictionCurve, joint: Coordinate, j: int, parts: TorqueParts) -> Figure:
    moving = np.flatnonzero(parts.moving[:, j])
    chosen = moving[evenly(len(moving), POINTS)]
    speed, half = curve.speed, curve.half_width
    middle = len(speed) // 2
    sides = (slice(None, middle), slice(middle, None))
    # Later traces are drawn over earlier ones: the band must not hide the points.
    traces = [_band(speed[at], curve.effort[at], half[at]) for at in sides]
    traces.append(
        points("measured", parts.dq[chosen, j], parts.friction[chosen, j], "--measured", 4)
    )
    hover = f"%{{x:.3g}} {joint.unit}/s: %{{y:.3g}} {joint.effort_unit}<extra></extra>"
    traces.append(
        line("friction", speed, curve.effort, "--predicted", width=2.5, hovertemplate=hover)
    )
    label = f"Friction of {curve.joint} over its speed, with samples"
    axes = f"speed [{joint.unit}/s]", f"friction [{joint.effort_unit}]"
    return Figure(curve.joint, label, *axes, traces, {"showlegend": False})


def _band(speed: Array, effort: Array, half: Array) -> dict[str, Any]:
    return area("95 % interval", speed, effort - half, effort + half, "--surely", 0.7)


def _curve_dict(curve: FrictionCurve) -> dict[str, Any]:
    return {
        "joint": curve.joint,
        "speed": [rounded(x) for x in curve.speed],
        "friction": [rounded(x) for x in curve.effort],
        "half_width": [rounded(x) for x in curve.half_width],
    }

"""Position, speed and acceleration of every joint, with their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.report.content import ReportContent
from steelyard.report.html import fill, packed, rounded, script_json
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.design_words import used
from steelyard.report.text.words import percent, significant
from steelyard.report.thin import thin

if TYPE_CHECKING:
    from steelyard.excitation.result import Designed

POINTS = 1000
"""Most points of one line."""

BUDGET = 150_000
"""Points of all lines together."""

RATE = 100.0
"""Samples a second of which the points are chosen."""

ORDERS = ("position", "velocity", "acceleration")
COLOURS = ("--blue", "--vermillion", "--green")
DOMAINS = ((0.56, 1.0), (0.29, 0.48), (0.0, 0.19))
"""Of the three parts of a picture, from its foot."""

ROOM = 0.06
"""Share of the limits' width that is drawn beyond them."""


class DesignJointsSection(Section):
    """One picture per joint."""

    name: ClassVar[str] = "design-joints"
    title: ClassVar[str] = "Motion of the joints"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Lines and limits of every joint."""
        designed = content.design
        if designed is None:
            return None
        n = designed.robot.n
        most = max(min(POINTS, BUDGET // (len(ORDERS) * n)), 50)
        motion = designed.trajectory
        t = np.linspace(0.0, motion.duration, max(int(RATE * motion.duration), POINTS) + 1)
        lines = [motion.derivative(t, order) for order in range(len(ORDERS))]
        return {
            "joints": [
                {
                    "name": joint.name,
                    "caption": _caption(designed, k),
                    "picture": script_json(_figure(designed, k, t, lines, most)),
                }
                for k, joint in enumerate(designed.robot.coordinates)
            ]
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_joints.html", numbers)


def _caption(designed: Designed, joint: int) -> str:
    """How far the joint goes, and how much of its speed and acceleration it uses."""
    name = designed.robot.coordinates[joint].name
    own = {one.quantity: one for one in designed.certificate.extremes if one.joint == name}
    words = []
    if "position" in own:
        far = own["position"]
        words.append(f"{significant(far.least)} … {significant(far.greatest)} {far.unit}")
    for quantity, short in (("velocity", "speed"), ("acceleration", "accel.")):
        share = used(own[quantity]) if quantity in own else None
        if share is not None:
            words.append(f"{short}\u00a0{percent(100.0 * share)}")
    return ", ".join(words)


def _figure(
    designed: Designed, joint: int, t: Array, lines: list[Array], most: int
) -> dict[str, Any]:
    """Three lines above each other on one axis of time."""
    unit = designed.robot.coordinates[joint].unit
    limits = designed.limits
    bounds = [
        (limits.lower[joint], limits.upper[joint]),
        (-limits.velocity[joint], limits.velocity[joint]),
        (-limits.acceleration[joint], limits.acceleration[joint]),
    ]
    units = (unit, f"{unit}/s", f"{unit}/s²")
    traces, shapes = list[dict[str, Any]](), list[dict[str, Any]]()
    layout: dict[str, Any] = {}
    for k, (low, high) in enumerate(bounds):
        axis = "" if k == 0 else str(k + 1)
        signal = lines[k][:, joint]
        chosen = thin(signal, most)
        traces.append(
            {
                "name": ORDERS[k],
                "kind": "line",
                "x": packed(t[chosen]),
                "y": packed(signal[chosen]),
                "more": {
                    "yaxis": f"y{axis}",
                    "line": {"color": COLOURS[k], "width": 1.8},
                    "hovertemplate": f"%{{y:.4g}} {units[k]}<extra>{ORDERS[k]}</extra>",
                },
            }
        )
        shapes += _limits(f"y{axis}", float(low), float(high))
        room = ROOM * (high - low)
        layout[f"yaxis{axis}"] = {
            "domain": DOMAINS[k],
            "range": [rounded(low - room), rounded(high + room)],
            "title": {"text": units[k], "standoff": 4},
            "nticks": 5 if k == 0 else 3,
            "zeroline": True,
        }
    layout |= {"shapes": shapes, "showlegend": False, "hovermode": "x unified"}
    layout["xaxis"] = {"anchor": "y3", "range": [0.0, rounded(t[-1])]}
    return {"x": "time [s]", "y": units[0], "traces": traces, "layout": layout}


def _limits(axis: str, low: float, high: float) -> list[dict[str, Any]]:
    """The allowed band, with its edges."""
    across = {"xref": "paper", "x0": 0, "x1": 1, "yref": axis, "layer": "below"}
    edge = {"type": "line", **across, "line": {"color": "--poor", "width": 1, "dash": "dot"}}
    band = {"type": "rect", **across, "fillcolor": "--allowed", "line": {"width": 0}}
    low_, high_ = rounded(low), rounded(high)
    return [
        {**band, "y0": low_, "y1": high_},
        {**edge, "y0": low_, "y1": low_},
        {**edge, "y0": high_, "y1": high_},
    ]

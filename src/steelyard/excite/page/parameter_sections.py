"""Sections of a designed motion: joints over time, accuracy of parameters, additional motions."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.identified_parameters import WELL
from steelyard.excite.page.design_words import (
    DesignContent,
    Expected,
    brings,
    capitalised,
    expected,
    helpful,
    instead,
)
from steelyard.report.figures import line, thin
from steelyard.report.page import Numbers, Section, rounded, script_json
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import percent, significant

if TYPE_CHECKING:
    from steelyard.excite.designed import Designed


JOINT_LINE_POINTS = 1000  # most points of one line
JOINT_POINTS_BUDGET = 150_000  # points of all lines together
JOINT_SAMPLES_A_SECOND = 100.0  # samples a second of which the points are chosen

JOINT_ORDERS = ("position", "velocity", "acceleration")
JOINT_COLOURS = ("--blue", "--vermillion", "--green")
JOINT_DOMAINS = ((0.56, 1.0), (0.29, 0.48), (0.0, 0.19))  # of three parts, from the foot

LIMITS_ROOM_SHARE = 0.06  # share of the limits' width that is drawn beyond them


class DesignJointsSection(
    Section, name="design-joints", title="Motion of the joints", template="design_joints.html"
):
    """One picture per joint."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """Lines and limits of every joint."""
        designed = content.design
        n = designed.robot.n
        most = max(min(JOINT_LINE_POINTS, JOINT_POINTS_BUDGET // (len(JOINT_ORDERS) * n)), 50)
        motion = designed.trajectory
        t = np.linspace(
            0.0,
            motion.duration,
            max(int(JOINT_SAMPLES_A_SECOND * motion.duration), JOINT_LINE_POINTS) + 1,
        )
        lines = [motion.derivative(t, order) for order in range(len(JOINT_ORDERS))]
        return {
            "joints": [
                {
                    "name": joint.name,
                    "caption": _joint_caption(designed, k),
                    "picture": script_json(_joint_figure(designed, k, t, lines, most)),
                }
                for k, joint in enumerate(designed.robot.coordinates)
            ]
        }


def _joint_caption(designed: Designed, joint: int) -> str:
    name = designed.robot.coordinates[joint].name
    own = {one.quantity: one for one in designed.certificate.extremes if one.joint == name}
    words = []
    if "position" in own:
        far = own["position"]
        words.append(f"{significant(far.least)} … {significant(far.greatest)} {far.unit}")
    for quantity, short in (("velocity", "speed"), ("acceleration", "accel.")):
        share = own[quantity].used if quantity in own else None
        if share is not None:
            words.append(f"{short}\u00a0{percent(100.0 * share)}")
    return ", ".join(words)


def _joint_figure(
    designed: Designed, joint: int, t: Array, lines: list[Array], most: int
) -> dict[str, Any]:
    unit = designed.robot.coordinates[joint].unit
    bounds = [(low[joint], high[joint]) for low, high in designed.limits.bounds[:3]]
    units = (unit, f"{unit}/s", f"{unit}/s²")
    traces, shapes = list[dict[str, Any]](), list[dict[str, Any]]()
    layout: dict[str, Any] = {}
    for k, (low, high) in enumerate(bounds):
        axis = "" if k == 0 else str(k + 1)
        signal = lines[k][:, joint]
        chosen = thin(signal, most)
        hover = f"%{{y:.4g}} {units[k]}<extra>{JOINT_ORDERS[k]}</extra>"
        more = {"width": 1.8, "yaxis": f"y{axis}", "hovertemplate": hover}
        traces.append(line(JOINT_ORDERS[k], t[chosen], signal[chosen], JOINT_COLOURS[k], **more))
        # the allowed band, with its edges
        across = {"xref": "paper", "x0": 0, "x1": 1, "yref": f"y{axis}", "layer": "below"}
        edge = {"type": "line", **across, "line": {"color": "--poor", "width": 1, "dash": "dot"}}
        band = {"type": "rect", **across, "fillcolor": "--allowed", "line": {"width": 0}}
        ends = rounded(float(low)), rounded(float(high))
        shapes.append({**band, "y0": ends[0], "y1": ends[1]})
        shapes += [{**edge, "y0": end, "y1": end} for end in ends]
        room = LIMITS_ROOM_SHARE * (high - low)
        layout[f"yaxis{axis}"] = {
            "domain": JOINT_DOMAINS[k],
            "range": [rounded(low - room), rounded(high + room)],
            "title": {"text": units[k], "standoff": 4},
            "nticks": 5 if k == 0 else 3,
            "zeroline": True,
        }
    layout |= {"shapes": shapes, "showlegend": False, "hovermode": "x unified"}
    layout["xaxis"] = {"anchor": "y3", "range": [0.0, rounded(t[-1])]}
    return {"x": "time [s]", "y": units[0], "traces": traces, "layout": layout}


OPEN_ROWS = 12  # rows of the table that are seen at once
FULL_BAR_PERCENT = 50.0  # relative standard deviation [%] of a full bar
SINGULAR_VALUES_FLOOR = 1e-8  # singular values below this share of the greatest are drawn there


class DesignShownSection(
    Section, name="design-shown", title="Predicted accuracy", template="design_shown.html"
):
    """Predicted standard deviations, what they assume, and singular values."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """All base parameters, the worst shown first."""
        designed = content.design
        rows = [_accuracy_row(one) for one in expected(designed)]
        return {
            "rows": rows[:OPEN_ROWS],
            "more": rows[OPEN_ROWS:],
            "values": any(row["value"] is not None for row in rows),
            "unseen": sum(row["grade"] == "poor" for row in rows),
            "well": WELL,
            "noise": [
                (joint.name, f"{significant(float(x), 2)} {joint.effort_unit}")
                for joint, x in zip(designed.robot.coordinates, designed.noise, strict=True)
            ],
            "noise_from": capitalised(designed.noise_from),
            "prior": designed.prior is not None,
            "picture": script_json(_singular_values_figure(designed)),
            "raw": designed.shown.raw,
            "normalised": designed.shown.normalised,
        }


def _accuracy_row(one: Expected) -> dict[str, Any]:
    share = one.relative_percent
    if not isfinite(one.std):
        grade, bar = "poor", 100.0
    elif share is None:
        grade, bar = "none", 0.0
    else:
        grade, bar = (
            ("fair" if share > WELL else "good"),
            min(100.0 * share / FULL_BAR_PERCENT, 100.0),
        )
    return {**vars(one), "grade": grade, "bar": bar}


def _singular_values_figure(designed: Designed) -> dict[str, Any]:
    singular = designed.shown.singular
    top = float(singular.max(initial=0.0)) or 1.0
    share = np.maximum(singular / top, SINGULAR_VALUES_FLOOR)
    # a bit beyond the values, and a decade at least
    decades = [min(float(np.log10(share.min())) - 0.15, -1.15), 0.15]
    return {
        "x": "number",
        "y": "singular value over the greatest",
        "traces": [
            {
                "name": "singular values",
                "kind": "points",
                "x": list(range(1, len(share) + 1)),
                "y": [rounded(float(x)) for x in share],
                "more": {
                    "mode": "lines+markers",
                    "line": {"color": "--pale", "width": 1.2},
                    "marker": {"color": "--blue", "size": 6},
                    "hovertemplate": "%{x}: %{y:.3g}<extra></extra>",
                },
            }
        ],
        "layout": {
            "showlegend": False,
            "xaxis": {"range": [0.0, len(share) + 1.0]},
            "yaxis": {"type": "log", "dtick": 1, "range": decades},
        },
    }


class DesignAdviceSection(
    Section, name="design-advice", title="Additional motions", template="design_advice.html"
):
    """Motions beside the designed one."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """What each of them would bring."""
        designed = content.design
        if not designed.advice:
            return None
        rows = [
            Row(
                (
                    one.what,
                    f"{one.seconds:.3g} s",
                    f"{len(one.helps)} of {len(designed.shown.names)}",
                    brings(designed, one),
                    instead(designed, one),
                )
            )
            for one in helpful(designed.advice)
        ]
        headings = (
            "Additional motion",
            "Length",
            "Parameters improved",
            "Predicted std",
            "This motion, extended by the same time",
        )
        return {"tables": [PlainTable("", "", headings, rows, (0, 3))], "title": self.title}

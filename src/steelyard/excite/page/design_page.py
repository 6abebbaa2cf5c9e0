"""The page of a designed motion and its sections: verdict, joints, accuracy, proof, search."""

from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import WELL
from steelyard.excite.constraints.certificate import COVERS, Extreme, Proof
from steelyard.excite.page import design_text as words
from steelyard.excite.page.design_text import DesignContent
from steelyard.excite.page.tool_path_and_walls import DesignToolSection
from steelyard.excite.predicted_accuracy_and_advice import Advice
from steelyard.excite.searched_or_planned_motion import Designed
from steelyard.identify.page.gains_offsets_search_and_settings import SettingsSection
from steelyard.report.page import Numbers, Section, render_sections, rounded, script_json
from steelyard.report.page_figures import line, thin
from steelyard.report.tables import PlainTable, Row, table_of
from steelyard.report.words import NONE, count, percent, significant


class DesignVerdictSection(
    Section, name="design", title="The designed motion", template="design_verdict.html"
):
    """Headline, figures, what is tight, and what was assumed."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """Everything, if a motion was designed."""
        designed = content.design
        rows = [
            Row((one.kind, one.name, words.left_words(one), words.used_words(one)))
            for one in words.nearest(designed)
        ]
        headings = ("Limit", "Where it is nearest", "Left", words.USED_SHARE_HEADING)
        return {
            "level": words.design_level(designed),
            "headline": words.design_headline(designed),
            "detail": words.design_detail(designed),
            "scopes": words.scopes(designed),
            "facts": _facts(designed),
            "failures": designed.certificate.failures,
            "tables": [PlainTable("Smallest margins", "", headings, rows, (0, 1))],
            "share": 100.0 * designed.limits.share,
            "covers": COVERS,
            "uncovered": designed.certificate.uncovered,
        }


def _facts(designed: Designed) -> list[tuple[str, str]]:
    shown, total = designed.shown, len(designed.shown.names)
    top = max((one.used for one in words.joint_limits(designed)), default=None)
    return [
        (significant(shown.raw), "condition number, raw"),
        (significant(shown.normalised), "condition number, columns of unit length"),
        (f"{designed.trajectory.duration:.4g} s", "duration"),
        (f"{total - words.unseen(designed)} of {total}", "base parameters identifiable"),
        (NONE if top is None else f"{100.0 * top:.3g} %", "use of the closest joint limit"),
    ]


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
    shown = []
    if "position" in own:
        far = own["position"]
        shown.append(f"{significant(far.least)} … {significant(far.greatest)} {far.unit}")
    for quantity, short in (("velocity", "speed"), ("acceleration", "accel.")):
        share = own[quantity].used if quantity in own else None
        if share is not None:
            shown.append(f"{short}\u00a0{percent(100.0 * share)}")
    return ", ".join(shown)


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
        rows = [_accuracy_row(one) for one in words.expected(designed)]
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
            "noise_from": words.capitalised(designed.noise_from),
            "prior": designed.prior is not None,
            "picture": script_json(_singular_values_figure(designed)),
            "raw": designed.shown.raw,
            "normalised": designed.shown.normalised,
        }


def _accuracy_row(one: words.Expected) -> dict[str, Any]:
    share = one.relative_percent
    if not isfinite(one.std):
        grade, bar = "poor", 100.0
    elif share is None:
        grade, bar = "none", 0.0
    else:
        grade = "fair" if share > WELL else "good"
        bar = min(100.0 * share / FULL_BAR_PERCENT, 100.0)
    return {**vars(one), "grade": grade, "bar": bar}


def _singular_values_figure(designed: Designed) -> dict[str, Any]:
    singular = designed.shown.singular
    top = float(singular.max(initial=0.0)) or 1.0
    share = np.maximum(singular / top, SINGULAR_VALUES_FLOOR)
    # a bit beyond the values, and a decade at least
    decades = [min(float(np.log10(share.min())) - 0.15, -1.15), 0.15]
    numbers = np.arange(1.0, len(share) + 1.0)
    marker, hover = {"color": "--blue", "size": 6}, "%{x}: %{y:.3g}<extra></extra>"
    more = {"mode": "lines+markers", "marker": marker, "hovertemplate": hover}
    values = line("singular values", numbers, share, "--pale", width=1.2, **more)
    layout = {
        "showlegend": False,
        "xaxis": {"range": [0.0, len(share) + 1.0]},
        "yaxis": {"type": "log", "dtick": 1, "range": decades},
    }
    x, y = "number", "singular value over the greatest"
    return {"x": x, "y": y, "traces": [values], "layout": layout}


class DesignAdviceSection(
    Section, name="design-advice", title="Additional motions", template="design_advice.html"
):
    """Motions beside the designed one."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """What each of them would bring."""
        designed = content.design
        if not designed.advice:
            return None
        columns: dict[str, Callable[[Advice], str]] = {
            "Additional motion": lambda one: one.what,
            "Length": lambda one: words.seconds_text(one.seconds),
            "Parameters improved": lambda one: f"{len(one.helps)} of {len(designed.shown.names)}",
            "Predicted std": partial(words.brings, designed),
            "This motion, extended by the same time": partial(words.instead, designed),
        }
        return {"tables": [table_of(words.helpful(designed.advice), columns, text=(0, 3))]}


QUANTITY_NAMES = {"velocity": "speed"}  # quantities by another name


class DesignProofSection(
    Section, name="design-proof", title="Proven limits", template="design_proof.html"
):
    """Tables of extremes and of margins."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """The certificate."""
        certificate = content.design.certificate
        return {
            "holds": certificate.holds,
            "failures": certificate.failures,
            "how": certificate.how,
            "sha": certificate.trajectory,
            "quantities": list(dict.fromkeys(one.quantity for one in certificate.extremes)),
            "called": QUANTITY_NAMES,
            "joints": [
                (joint, [_extreme_cell(one) for one in certificate.extremes if one.joint == joint])
                for joint in dict.fromkeys(one.joint for one in certificate.extremes)
            ],
            "covers": COVERS,
            "uncovered": certificate.uncovered,
            "notes": [n for n in certificate.notes if n not in certificate.uncovered],
            "constraints": [_constraint_margins(proof) for proof in certificate.proofs],
        }


def _extreme_cell(one: Extreme) -> dict[str, Any]:
    share = one.used
    if one.quantity == "position":
        span = f"{significant(one.least)} … {significant(one.greatest)}"
    else:
        span = significant(max(abs(one.least), abs(one.greatest)))
    safe = one.margin is None or one.margin >= 0.0
    return {
        "quantity": one.quantity,
        "span": f"{span} {one.unit}",
        "percent": None if share is None else 100.0 * share,
        "bar": 0.0 if share is None else min(max(100.0 * share, 0.0), 100.0),
        "level": "good" if safe else "poor",
    }


def _constraint_margins(proof: Proof) -> dict[str, Any]:
    """A constraint: its margin nearest to its limit, and a table of all, the nearest first."""
    margins = zip(words.margins_of(proof), proof.sampled, strict=True)
    ordered = sorted(margins, key=lambda pair: words.rank(pair[0]))
    headings = ("Margin", "Proven at all times", "At samples", words.USED_SHARE_HEADING)
    rows = []
    for one, seen in ordered:
        both = (words.margin(value, one.unit) for value in (one.left, seen))
        rows.append(Row((one.name, *both, words.used_words(one))))
    near = [one for one, _ in ordered]
    return {
        "name": proof.name,
        "how": proof.how,
        "scope": proof.scope,
        "least": words.margin(near[0].left, proof.unit) if near else None,
        "label": near[0].name if near else "",
        "level": "good" if all(one.left >= 0.0 for one in near) else "poor",
        "count": count(len(rows), "margin"),
        "tables": [PlainTable("", "", headings, rows)],
    }


class DesignSearchSection(
    Section, name="design-search", title="The search", template="design_search.html"
):
    """A picture of all improvements, and whether more time would pay."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """Improvements, if the motion was searched for."""
        designed = content.design
        if not designed.course:
            return None
        last = designed.course[-1]
        return {
            "searches": words.searches(designed),
            "seconds": words.seconds_text(designed.seconds),
            "improved": count(len(designed.course), "time"),
            "last": words.seconds_text(last[0]),
            "best": significant(last[1]),
            "final": words.figure_of(designed),
            "stopped": designed.stopped,
            "picture": script_json(_search_figure(designed)),
        }


def _search_figure(designed: Designed) -> dict[str, Any]:
    """Steps down, and the end after scaling and proof as a point."""
    times, figures = zip(*designed.course, strict=True)
    end, hover = max(designed.seconds, times[-1]), "%{x:.3g} s: %{y:.4g}<extra></extra>"
    x, y, final = [*times, end], [*figures, figures[-1]], designed.shown.criterion_value
    marker = {"color": "--blue", "size": [7] * len(times) + [0]}
    steps = {"mode": "lines+markers", "marker": marker, "hovertemplate": hover}
    found = line("best found", np.array(x), np.array(y), "--blue", **steps)
    found["more"]["line"]["shape"] = "hv"
    diamond = {"color": "--green", "size": 11, "symbol": "diamond"}
    at = {"mode": "markers", "marker": diamond, "hovertemplate": hover, "cliponaxis": False}
    name = "refined, scaled exactly and proven"
    proven = line(name, np.array([end]), np.array([final]), "--green", **at)
    layout = {"xaxis": {"range": [0.0, rounded(1.03 * end)]}}
    return {"x": "time [s]", "y": designed.criterion, "traces": [found, proven], "layout": layout}


class DesignRunSection(Section, name="design-run", title="Run it", template="design_run.html"):
    """Files and commands."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """Files, and whether the motion may be run."""
        designed = content.design
        return {
            "safe": designed.certificate.holds,
            "files": content.files,
            "seconds": f"{designed.trajectory.duration:.4g} s",
            "slow": f"{5.0 * designed.trajectory.duration:.4g} s",
        }


DESIGN_SECTIONS: tuple[Section, ...] = (
    DesignVerdictSection(),
    DesignJointsSection(),
    DesignToolSection(),
    DesignShownSection(),
    DesignAdviceSection(),
    DesignProofSection(),
    DesignSearchSection(),
    DesignRunSection(),
)


def render_design(content: DesignContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    return render_sections((*DESIGN_SECTIONS, SettingsSection()), content, "designed")

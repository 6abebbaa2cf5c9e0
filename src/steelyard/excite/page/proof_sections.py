"""Sections of a designed motion: verdict, proven limits, course of the search, how to run it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from steelyard.excite.constraints.certificate import COVERS
from steelyard.excite.page.design_words import (
    USED_SHARE_HEADING,
    DesignContent,
    design_detail,
    design_headline,
    design_level,
    figure_of,
    joint_limits,
    left_words,
    margin,
    margins_of,
    nearest,
    rank,
    scopes,
    searches,
    unseen,
    used_words,
)
from steelyard.excite.page.parameter_sections import (
    DesignAdviceSection,
    DesignJointsSection,
    DesignShownSection,
)
from steelyard.excite.page.tool_section import DesignToolSection
from steelyard.identify.page.content import SettingsSection
from steelyard.report.page import (
    Numbers,
    Section,
    render_sections,
    rounded,
    script_json,
)
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import NONE, count, significant

if TYPE_CHECKING:
    from steelyard.excite.constraints.certificate import Extreme, Proof
    from steelyard.excite.designed import Designed


class DesignVerdictSection(
    Section, name="design", title="The designed motion", template="design_verdict.html"
):
    """Headline, figures, what is tight, and what was assumed."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """Everything, if a motion was designed."""
        designed = content.design
        rows = [
            Row((one.kind, one.name, left_words(one), used_words(one))) for one in nearest(designed)
        ]
        headings = ("Limit", "Where it is nearest", "Left", USED_SHARE_HEADING)
        return {
            "level": design_level(designed),
            "headline": design_headline(designed),
            "detail": design_detail(designed),
            "scopes": scopes(designed),
            "facts": _facts(designed),
            "failures": designed.certificate.failures,
            "tables": [PlainTable("Smallest margins", "", headings, rows, (0, 1))],
            "title": self.title,
            "share": 100.0 * designed.limits.share,
            "covers": COVERS,
            "uncovered": designed.certificate.uncovered,
        }


def _facts(designed: Designed) -> list[tuple[str, str]]:
    shown, total = designed.shown, len(designed.shown.names)
    top = max((one.used for one in joint_limits(designed)), default=None)
    return [
        (significant(shown.raw), "condition number, raw"),
        (significant(shown.normalised), "condition number, columns of unit length"),
        (f"{designed.trajectory.duration:.4g} s", "duration"),
        (f"{total - unseen(designed)} of {total}", "base parameters identifiable"),
        (NONE if top is None else f"{100.0 * top:.3g} %", "use of the closest joint limit"),
    ]


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
    margins = zip(margins_of(proof), proof.sampled, strict=True)
    ordered = sorted(margins, key=lambda pair: rank(pair[0]))
    rows = [
        Row((one.name, margin(one.left, one.unit), margin(seen, one.unit), used_words(one)))
        for one, seen in ordered
    ]
    near = [one for one, _ in ordered]
    holds = all(one.left >= 0.0 for one in near)
    return {
        "name": proof.name,
        "how": proof.how,
        "scope": proof.scope,
        "least": margin(near[0].left, proof.unit) if near else None,
        "label": near[0].name if near else "",
        "level": "good" if holds else "poor",
        "count": count(len(rows), "margin"),
        "tables": [
            PlainTable(
                "", "", ("Margin", "Proven at all times", "At samples", USED_SHARE_HEADING), rows
            )
        ],
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
            "searches": searches(designed),
            "seconds": f"{designed.seconds:.3g} s",
            "improved": count(len(designed.course), "time"),
            "last": f"{last[0]:.3g} s",
            "best": significant(last[1]),
            "final": figure_of(designed),
            "stopped": designed.stopped,
            "picture": script_json(_search_figure(designed)),
        }


def _search_figure(designed: Designed) -> dict[str, Any]:
    """Steps down, and the end after scaling and proof as a point."""
    times, figures = zip(*designed.course, strict=True)
    end = max(designed.seconds, times[-1])
    return {
        "x": "time [s]",
        "y": designed.criterion,
        "traces": [
            {
                "name": "best found",
                "kind": "line",
                "x": [rounded(x) for x in (*times, end)],
                "y": [rounded(y) for y in (*figures, figures[-1])],
                "more": {
                    "mode": "lines+markers",
                    "line": {"shape": "hv", "color": "--blue", "width": 2},
                    "marker": {"color": "--blue", "size": [7] * len(times) + [0]},
                    "hovertemplate": "%{x:.3g} s: %{y:.4g}<extra></extra>",
                },
            },
            {
                "name": "refined, scaled exactly and proven",
                "kind": "points",
                "x": [rounded(end)],
                "y": [rounded(designed.shown.criterion_value)],
                "more": {
                    "marker": {"color": "--green", "size": 11, "symbol": "diamond"},
                    "hovertemplate": "%{x:.3g} s: %{y:.4g}<extra></extra>",
                    "cliponaxis": False,
                },
            },
        ],
        "layout": {"xaxis": {"range": [0.0, rounded(1.03 * end)]}},
    }


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
"""Sections about a designed motion."""


def render_design(content: DesignContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    return render_sections((*DESIGN_SECTIONS, SettingsSection()), content, "designed")

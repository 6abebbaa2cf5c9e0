"""Proven limits to hold at all times: extremes of every joint, margins of every constraint."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.excitation.constraints.certificate import COVERS
from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.design_words import (
    USED,
    margin,
    margins_of,
    rank,
    uncovered,
    used,
    used_words,
)
from steelyard.report.text.words import count, significant

if TYPE_CHECKING:
    from steelyard.excitation.constraints.certificate import Certificate, Extreme
    from steelyard.excitation.constraints.proof import Proof

CALLED = {"velocity": "speed"}
"""Quantities by another name."""


class DesignProofSection(Section):
    """Tables of extremes and of margins."""

    name: ClassVar[str] = "design-proof"
    title: ClassVar[str] = "Proven limits"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The certificate."""
        if content.design is None:
            return None
        certificate = content.design.certificate
        return {
            "holds": certificate.holds,
            "failures": certificate.failures,
            "how": certificate.how,
            "sha": certificate.trajectory,
            "quantities": list(dict.fromkeys(one.quantity for one in certificate.extremes)),
            "called": CALLED,
            "joints": _joints(certificate),
            "covers": COVERS,
            "uncovered": uncovered(content.design),
            "notes": [n for n in certificate.notes if n not in uncovered(content.design)],
            "constraints": [_constraint(proof) for proof in certificate.proofs],
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_proof.html", numbers)


def _joints(certificate: Certificate) -> list[tuple[str, list[dict[str, Any]]]]:
    """Joint by joint the extremes of each quantity."""
    joints = dict.fromkeys(one.joint for one in certificate.extremes)
    return [
        (joint, [_cell(one) for one in certificate.extremes if one.joint == joint])
        for joint in joints
    ]


def _cell(one: Extreme) -> dict[str, Any]:
    """Range and share of the limit that is used."""
    share = used(one)
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


def _constraint(proof: Proof) -> dict[str, Any]:
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
        "tables": [PlainTable("", "", ("Margin", "Proven at all times", "At samples", USED), rows)],
    }

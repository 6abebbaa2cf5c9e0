"""Proven limits to hold at all times: extremes of every joint, margins of every constraint."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.excitation.constraints.certificate import COVERS
from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.design_words import least, margin, uncovered, used
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
    """A constraint: its least margin, and a table of all of them, the least first."""
    margins = sorted(zip(proof.labels, proof.proven, proof.sampled, strict=True), key=_proven)
    rows = [
        Row((label, margin(proven, proof.unit), margin(seen, proof.unit)))
        for label, proven, seen in margins
    ]
    tightest = least(proof)
    return {
        "name": proof.name,
        "how": proof.how,
        "scope": proof.scope,
        "least": None if tightest is None else margin(tightest[1], proof.unit),
        "label": "" if tightest is None else tightest[0],
        "level": "good" if tightest is None or tightest[1] >= 0.0 else "poor",
        "count": count(len(rows), "margin"),
        "tables": [PlainTable("", "", ("Margin", "Proven at all times", "At samples"), rows)],
    }


def _proven(margins: tuple[str, float, float]) -> float:
    return margins[1]

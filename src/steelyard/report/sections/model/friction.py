"""How the friction laws, and what they are not linear in, were found."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.estimation.fields.fields import Finding
from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import count, significant
from steelyard.terms.term import StatefulTerm
from steelyard.validation.friction.friction import FrictionChoice

if TYPE_CHECKING:
    from rich.console import RenderableType

ERROR = (
    "geometric mean of two errors, that of all joints together and the geometric mean over joints, "
    "after the parallel filter; not comparable with the verdict"
)
"""What an error of a mix is."""
ONE_CURVE = (
    "Their coefficients describe one friction curve per joint together and are valid only "
    "together: quote the curve (report), not a coefficient"
)
"""What coefficients of chosen laws mean."""


class FrictionSection(TableSection):
    """The mixes that were compared, and the fields that were found."""

    name: ClassVar[str] = "friction"
    title: ClassVar[str] = "Friction"

    in_terminal: ClassVar[bool] = True

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table each, if there is anything in it."""
        mixes = [] if content.friction is None else [_mixes(content.friction)]
        return [*mixes, *([_fields(content.findings)] if content.findings else [])]

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The laws that were chosen, and how much of the error they take away."""
        from rich.text import Text

        if content.friction is not None:
            yield Text(_chosen(content.friction))

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The tables; laws for controllers that keep no state, where the chosen ones need one."""
        from rich.text import Text

        yield from super().detailed(content)
        if content.friction is not None and (other := without_memory(content.friction)):
            yield Text(other)
        if content.friction is None and content.identified is not None:
            terms = content.identified.model.terms
            laws = [term.law for term in terms if isinstance(term, StatefulTerm)]
            if laws:
                yield Text(
                    f"friction laws with memory ({', '.join(laws)}): for controllers that keep no "
                    "state between samples choose laws without memory; friction = "
                    '"auto" compares them'
                )

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The choice of laws, and the fields."""
        return {
            "friction": None if content.friction is None else content.friction.to_dict(),
            "fields": [finding.to_dict() for finding in content.findings],
        }


def _chosen(choice: FrictionChoice) -> str:
    """The chosen laws beside the first row of the table."""
    first, best = choice.table[0], next(mix for mix in choice.table if mix.chosen)
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
    best = next(mix for mix in choice.table if mix.chosen)
    more = 100.0 * (other.error / best.error - 1.0)
    return (
        'for controllers that keep no state between samples: friction = "auto_memoryless", laws '
        f"without memory such as {other.name} (error on motion left out {abs(more):.0f} % "
        f"{'larger' if more >= 0.0 else 'smaller'} in this comparison)"
    )


def _mixes(choice: FrictionChoice) -> PlainTable:
    rows = [
        Row(
            (
                mix.name,
                f"{mix.error:.2f} %",
                f"{mix.gain:.1f} %",
                f"± {mix.spread:.1f} %",
                "chosen" if mix.chosen else "",
            ),
            mix.chosen,
        )
        for mix in choice.table
    ]
    other, said = without_memory(choice), _chosen(choice)
    return PlainTable(
        "Friction laws compared",
        f"Cross-validation: each {choice.left_out} is predicted by a fit to all others. Error: "
        f"{ERROR}; "
        "improvement relative to the first row, with its standard error. A simpler combination is "
        "preferred unless the improvement by a better one is significant. Speeds are in rad/s, "
        "lengths in rad (prismatic joints: m/s, m)."
        + (f" {other[0].upper()}{other[1:]}." if other else ""),
        ("Friction laws", "Error", "Improvement", "Standard error", ""),
        rows,
        (0, 4),
        f"cross-validation, leaving out one {choice.left_out} at a time; error: {ERROR}",
        f"{said[0].upper()}{said[1:]}",
    )


def _fields(findings: tuple[Finding, ...]) -> PlainTable:
    rows = [
        Row(
            (
                finding.term,
                finding.field,
                finding.joint or "all",
                significant(finding.value),
                f"{significant(finding.interval[0])} to {significant(finding.interval[1])}",
                "" if finding.identifiable else "not identifiable",
            )
        )
        for finding in findings
    ]
    return PlainTable(
        "Estimated nonlinear parameters",
        "Parameters in which the torque is nonlinear, with 95 % intervals, cut at the bounds of "
        "the search.",
        ("Term", "Parameter", "Joint", "Value", "Interval", ""),
        rows,
        (0, 1, 2, 5),
    )

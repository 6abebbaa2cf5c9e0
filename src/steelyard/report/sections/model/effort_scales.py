"""Scales of the logged efforts that were estimated."""

from typing import Any, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import alike, significant
from steelyard.validation.effort_scales import BEFORE, EffortScales


class EffortScalesSection(TableSection):
    """Scales with intervals."""

    name: ClassVar[str] = "effort_scales"
    title: ClassVar[str] = "Scales of the efforts"

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if scales were estimated."""
        return [] if content.scales is None else [_scales(content.scales)]

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The scales."""
        return {"effort_scales": None if content.scales is None else content.scales.to_dict()}


def _scales(scales: EffortScales) -> PlainTable:
    words = (
        "Logged effort over the effort of the common rigid-body model, with 95 % "
        f"intervals; each is {BEFORE}. Error on left-out motion with them "
        f"{significant(scales.error)} %, without {significant(scales.without)} %. Either a sensor "
        "or gain is off by this factor, or a missing term has the same effect; masses are as "
        "uncertain as the scales."
    )
    values = zip(
        scales.joints, scales.found.values.tolist(), scales.half_width.tolist(), strict=True
    )
    rows = [Row((joint, alike(x, half), f"± {significant(half, 2)}")) for joint, x, half in values]
    return PlainTable("", words, ("Joint", "Scale", "95 % interval"), rows, (0,))

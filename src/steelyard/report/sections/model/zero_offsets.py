"""Zero offsets of joints that were identified."""

from typing import Any, ClassVar

from steelyard.estimation.zero_offset import ZeroOffsets
from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import alike, significant


class ZeroOffsetsSection(TableSection):
    """Offsets with intervals."""

    name: ClassVar[str] = "zero_offsets"
    title: ClassVar[str] = "Zero offsets"

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if offsets were identified."""
        return [] if content.offsets is None else [_offsets(content.offsets)]

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The offsets."""
        return {"zero_offsets": None if content.offsets is None else content.offsets.to_dict()}


def _offsets(found: ZeroOffsets) -> PlainTable:
    words = (
        "Joint position = logged position + offset, with 95 % intervals. The offset of a first "
        "joint about gravity and that of a last joint change no torque that the parameters do not "
        "express: they are not identifiable."
    )
    rows = [
        Row((joint, alike(value, half), f"± {significant(half, 2)}", unit))
        if half == half
        else Row((joint, significant(value), "not identifiable" if asked else "given", unit))
        for joint, value, half, asked, unit in zip(
            found.joints,
            found.values.tolist(),
            found.half_width.tolist(),
            found.wanted,
            found.units,
            strict=True,
        )
    ]
    return PlainTable("", words, ("Joint", "Offset", "95 % interval", "Unit"), rows, (0, 3))

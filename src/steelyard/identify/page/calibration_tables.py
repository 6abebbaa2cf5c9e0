"""Tables of drive gains, effort scales, zero offsets and parameters of single runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.estimate.estimate import RunParameters
from steelyard.estimate.nonlinear.effort_scales import BEFORE, EffortScales
from steelyard.estimate.nonlinear.zero_offset import ZeroOffsets
from steelyard.estimate.payload.drive_gains import DriveGain, GainEstimate
from steelyard.identify.page.content import ReportContent
from steelyard.report.page import TableSection
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import rounded_to_uncertainty, significant

if TYPE_CHECKING:
    from rich.console import RenderableType


ASSUMED_GAIN = "assumed: geometric mean of the others"
"""Origin of a gain that the data do not identify."""


class DrivesSection(TableSection):
    """Gains with intervals."""

    name: ClassVar[str] = "drives"
    title: ClassVar[str] = "Drive gains"

    in_terminal: ClassVar[bool] = True

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if gains were identified."""
        return [] if content.gains is None else [_gains(content.gains)]

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The gains in one line."""
        from rich.text import Text

        if content.gains is not None:
            each = content.gains.each
            heading = "drive gains (± 95 %)" if any(map(_has_interval, each)) else "drive gains"
            yield Text(f"{heading}: {', '.join(map(_words, each))}")

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The gains."""
        return {"gains": None if content.gains is None else content.gains.to_dict()}


def _gains(gains: GainEstimate) -> PlainTable:
    intervals = any(map(_has_interval, gains.each))
    words = f"Joint effort per logged unit{', with 95 % intervals' if intervals else ''}."
    if gains.payload is not None:
        words += f" The payload of {significant(gains.payload.mass)} kg fixes their scale."
    rows = [
        Row((joint, significant(gain), _how(known, assumed, half), unit))
        for joint, gain, half, unit, known, assumed in gains.each
    ]
    how = "95 % interval" if intervals else "Origin"
    return PlainTable("", words, ("Joint", "Gain", how, "Unit"), rows, (0, 3))


def _has_interval(gain: DriveGain) -> bool:
    return not (gain.known or gain.assumed)


def _words(gain: DriveGain) -> str:
    """Like `elbow 9.97 ± 0.17 Nm/A`, or where the gain is from instead of its interval."""
    value = f"{gain.joint} {significant(gain.gain)}"
    if not _has_interval(gain):
        return f"{value} {gain.unit} ({'given' if gain.known else ASSUMED_GAIN})"
    return f"{value} ± {significant(gain.half_width, 2)} {gain.unit}"


def _how(known: bool, assumed: bool, half: float) -> str:
    if assumed:
        return f"{ASSUMED_GAIN}, not identifiable"
    return "given" if known else f"± {significant(half)}"


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
    rows = [
        Row((joint, rounded_to_uncertainty(x, half), f"± {significant(half, 2)}"))
        for joint, x, half in values
    ]
    return PlainTable("", words, ("Joint", "Scale", "95 % interval"), rows, (0,))


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
        Row((joint, rounded_to_uncertainty(value, half), f"± {significant(half, 2)}", unit))
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


class PerRunSection(TableSection):
    """One column a run."""

    name: ClassVar[str] = "per-run"
    title: ClassVar[str] = "Parameters per run"

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if there are such parameters."""
        runs = _runs(content)
        if not runs:
            return []
        names = list(dict.fromkeys(name for own in runs for name in own.parameters.names))
        found = [own.parameters.as_dict() for own in runs]
        rows = [Row((name, *(significant(known.get(name)) for known in found))) for name in names]
        words = (
            "Estimated separately for every run; for a new run the model uses their mean, with the "
            "spread between runs as its uncertainty."
        )
        return [PlainTable("", words, ("Parameter", *(own.run for own in runs)), rows)]

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The parameters of every run."""
        return {"per_run": [{"run": own.run, **own.parameters.as_dict()} for own in _runs(content)]}


def _runs(content: ReportContent) -> Sequence[RunParameters]:
    return () if content.identified is None else content.identified.estimate.per_run

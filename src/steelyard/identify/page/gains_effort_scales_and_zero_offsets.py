"""Sections of drive gains, effort scales, zero offsets and parameters per run."""

from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from steelyard.estimate.nonlinear.effort_scales import EffortScales
from steelyard.estimate.nonlinear.nonlinear_parameters import ZeroOffsets
from steelyard.estimate.payload.drive_gains import DriveGain, GainEstimate
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import PageContent, TableSection, ValueSection
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import rounded_to_uncertainty, significant

ASSUMED_GAIN = "assumed: geometric mean of the others"  # of a gain not identifiable


class DrivesSection(
    ValueSection, name="drives", title="Drive gains", value="gains", in_terminal=True
):
    """Gains with intervals."""

    def tables_of(self, found: GainEstimate, content: PageContent) -> Sequence[PlainTable]:
        """One row per joint."""
        intervals = any(map(_has_interval, found.each))
        words = f"Joint effort per logged unit{', with 95 % intervals' if intervals else ''}."
        if found.payload is not None:
            words += f" The payload of {significant(found.payload.mass)} kg fixes their scale."
        rows = [
            Row((one.joint, significant(one.gain), _interval_or_origin(one), one.unit))
            for one in found.each
        ]
        how = "95 % interval" if intervals else "Origin"
        return (PlainTable("", words, ("Joint", "Gain", how, "Unit"), rows, (0, 3)),)

    def printed(self, content: Any) -> Iterable[RenderableType]:
        """The gains in one line."""
        if content.gains is not None:
            each = content.gains.each
            heading = "drive gains (± 95 %)" if any(map(_has_interval, each)) else "drive gains"
            yield Text(f"{heading}: {', '.join(map(_words, each))}")


def _has_interval(gain: DriveGain) -> bool:
    return not (gain.known or gain.assumed)


def _words(gain: DriveGain) -> str:
    """Like `elbow 9.97 ± 0.17 Nm/A`, or where the gain is from instead of its interval."""
    value = f"{gain.joint} {significant(gain.gain)}"
    if not _has_interval(gain):
        return f"{value} {gain.unit} ({'given' if gain.known else ASSUMED_GAIN})"
    return f"{value} ± {significant(gain.half_width, 2)} {gain.unit}"


def _interval_or_origin(gain: DriveGain) -> str:
    if gain.assumed:
        return f"{ASSUMED_GAIN}, not identifiable"
    return "given" if gain.known else f"± {significant(gain.half_width)}"


class EffortScalesSection(
    ValueSection, name="effort_scales", title="Scales of the efforts", value="effort_scales"
):
    """Scales with intervals."""

    def tables_of(self, found: EffortScales, content: ReportContent) -> Sequence[PlainTable]:
        """One row per joint."""
        words = (
            "Logged effort over the effort of the common rigid-body model, with 95 % "
            f"intervals; each is {found.found.before}. Error on left-out motion with them "
            f"{significant(found.error)} %, without {significant(found.without)} %. Either a "
            "sensor or gain is off by this factor, or a missing term has the same effect; masses "
            "are as uncertain as the scales."
        )
        known = found.known
        values = zip(found.joints, known.values.tolist(), known.half_width.tolist(), strict=True)
        rows = [
            Row((joint, rounded_to_uncertainty(x, half), f"± {significant(half, 2)}"))
            for joint, x, half in values
        ]
        return (PlainTable("", words, ("Joint", "Scale", "95 % interval"), rows, (0,)),)


class ZeroOffsetsSection(
    ValueSection, name="zero_offsets", title="Zero offsets", value="zero_offsets"
):
    """Offsets with intervals."""

    def tables_of(self, found: ZeroOffsets, content: ReportContent) -> Sequence[PlainTable]:
        """One row per joint."""
        words = (
            "Joint position = logged position + offset, with 95 % intervals. The offset of a "
            "first joint about gravity and that of a last joint change no torque that the "
            "parameters do not express: they are not identifiable."
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
        return (PlainTable("", words, ("Joint", "Offset", "95 % interval", "Unit"), rows, (0, 3)),)


class PerRunSection(TableSection, name="per-run", title="Parameters per run"):
    """One column a run."""

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if there are such parameters."""
        runs = content.identified.estimate.per_run
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
        runs = content.identified.estimate.per_run
        return {"per_run": [{"run": own.run, **own.parameters.as_dict()} for own in runs]}

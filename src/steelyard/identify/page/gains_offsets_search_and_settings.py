"""Sections of gains, scales, zero offsets, parameters per run, genetic search, logs, settings."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import json_values
from steelyard.check.findings_text_and_page import diagnosis_dict, findings_of
from steelyard.estimate.nonlinear.effort_scales import EffortScales
from steelyard.estimate.nonlinear.nonlinear_parameters import ZeroOffsets
from steelyard.estimate.payload.drive_gains import DriveGain, GainEstimate
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.report import page
from steelyard.report.page_figures import Figure, Group, Key, line
from steelyard.report.tables import PlainTable, Row, table_of, text_table
from steelyard.report.words import rounded_to_uncertainty, significant

ASSUMED_GAIN = "assumed: geometric mean of the others"  # of a gain not identifiable


class DrivesSection(
    page.ValueSection, name="drives", title="Drive gains", value="gains", in_terminal=True
):
    """Gains with intervals."""

    def tables_of(self, found: GainEstimate, content: page.PageContent) -> Sequence[PlainTable]:
        """One row per joint."""
        intervals = any(map(_has_interval, found.each))
        words = f"Joint effort per logged unit{', with 95 % intervals' if intervals else ''}."
        if found.payload is not None:
            words += f" The payload of {significant(found.payload.mass)} kg fixes their scale."
        cells = ((x.joint, significant(x.gain), _interval_or_origin(x), x.unit) for x in found.each)
        rows = list(map(Row, cells))
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
    page.ValueSection, name="effort_scales", title="Scales of the efforts", value="effort_scales"
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
    page.ValueSection, name="zero_offsets", title="Zero offsets", value="zero_offsets"
):
    """Offsets with intervals."""

    def tables_of(self, found: ZeroOffsets, content: ReportContent) -> Sequence[PlainTable]:
        """One row per joint."""
        words = (
            "Joint position = logged position + offset, with 95 % intervals. The offset of a "
            "first joint about gravity and that of a last joint change no torque that the "
            "parameters do not express: they are not identifiable."
        )
        numbers = found.values.tolist(), found.half_width.tolist()
        rows = [
            Row((joint, rounded_to_uncertainty(value, half), f"± {significant(half, 2)}", unit))
            if half == half
            else Row((joint, significant(value), "not identifiable" if asked else "given", unit))
            for joint, unit, asked, value, half in zip(
                found.joints, found.units, found.wanted, *numbers, strict=True
            )
        ]
        return (PlainTable("", words, ("Joint", "Offset", "95 % interval", "Unit"), rows, (0, 3)),)


class PerRunSection(page.TableSection, name="per-run", title="Parameters per run"):
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


WORDS = (
    "Root mean square error over all samples of all joints, the objective of the genetic "
    "algorithm: of the best individual, and its mean over the individuals of each generation. The "
    "dashed line is that of least squares without bounds, below which no individual can be. If the "
    "best one still falls at the end, more generations or individuals, or narrower bounds, help."
)


class EvolutionSection(page.FigureSection, name="evolution", title="Genetic algorithm"):
    """The objective over generations, and the bounds of the search."""

    def numbers(self, content: ReportContent) -> page.Numbers | None:
        """A figure and a table, if the estimate is from a genetic algorithm."""
        found = content.identified.estimate.evolution
        if found is None:
            return None
        count = np.arange(1.0, len(found.best) + 1.0)
        units = "; ".join(dict.fromkeys(content.identified.model.robot.effort_units))
        label, y = "Best and mean root mean square error over the generations", "root mean square"
        free, least = "least squares without bounds", np.full(len(count), found.least_squares)
        traces = [
            line("mean", count, found.mean, "--measured"),
            line("best", count, found.best, "--predicted"),
            line(free, count, least, "--green", dash="dash"),
        ]
        layout = {"yaxis": {"type": "log"}}
        figure = Figure("", label, "generation", f"{y} error [{units}]", traces, layout)
        return {
            "words": WORDS,
            "legend": [
                Key("--measured", "mean of the individuals"),
                Key("--predicted", "best individual"),
                Key("--green", free),
            ],
            "groups": [Group([figure], columns="one")],
            "tables": (_bounds(content),),
            "folded": "Bounds of the search",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Bounds, best and mean error of every generation, and that of least squares."""
        return {"evolution": json_values(content.identified.estimate.evolution)}

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The bounds."""
        if content.identified.estimate.evolution is not None:
            yield text_table(_bounds(content), self.title)


def _bounds(content: ReportContent) -> PlainTable:
    estimate = content.identified.estimate
    found, known = estimate.evolution, estimate.parameters
    assert found is not None
    values, units = known.as_dict(), dict(zip(known.names, known.units, strict=True))
    return table_of(
        zip(found.names, found.lower.tolist(), found.upper.tolist(), strict=True),
        {
            "Parameter": lambda row: row[0],
            "Lower": lambda row: significant(row[1]),
            "Value": lambda row: significant(values[row[0]]),
            "Upper": lambda row: significant(row[2]),
            "Unit": lambda row: units[row[0]],
        },
        caption="Bounds of the search",
        words="From [[knowledge]], the laws, and for links from the masses of the prior: up to "
        "twice the mass and the second moments.",
        text=(0, 4),
        marked=lambda row: row[0] in estimate.at_bound,
        note="bold: at a bound" if estimate.at_bound else "",
    )


class SettingsSection(
    page.Section, name="settings", title="Notes and settings", folded=True, template="settings.html"
):
    """What was assumed, and everything that is needed to make the same results again."""

    def numbers(self, content: page.PageContent) -> page.Numbers | None:
        """Notes, settings, runs, and hashes of the files."""
        notes = (*content.notes, *content.details)
        origin = content.identified.provenance if isinstance(content, ReportContent) else None
        if origin is not None:
            notes += origin.notes
        elif not content.settings and not notes:
            return None
        shown = tuple(dict.fromkeys(notes))
        return {"settings": content.settings, "origin": origin, "notes": shown}


LETTERS_OF_LONG_VALUE = 80  # from which on it stands below its run


class QualitySection(
    page.Section, name="quality", title="Data quality", folded=True, template="quality.html"
):
    """Rows, rates, gaps and dropped samples of every run."""

    def numbers(self, content: page.PageContent) -> page.Numbers | None:
        """One column per label, one row per run; long values stand below their run."""
        if not content.qualities:
            return None
        values = [value for _, found in content.qualities for value in found]
        long = {label for label, value in values if len(value) > LETTERS_OF_LONG_VALUE}
        labels = [
            label for label in dict.fromkeys(label for label, _ in values) if label not in long
        ]
        return {
            "labels": labels,
            "runs": [
                (
                    run,
                    [dict(found).get(label, "") for label in labels],
                    [(label, value) for label, value in found if label in long],
                )
                for run, found in content.qualities
            ],
        }


FEW = 40_000  # most points of all pictures of the evidence together


class CheckSection(page.Section, name="check", title="Check of the logs", template="findings.html"):
    """The verdict on the logs, and every finding; what is not ok with its picture."""

    def numbers(self, content: ReportContent) -> page.Numbers | None:
        """The findings, if the logs were checked."""
        if content.diagnosis is None:
            return None
        return findings_of(content.diagnosis, FEW, fine=False)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The findings."""
        return {"check": None if content.diagnosis is None else diagnosis_dict(content.diagnosis)}

"""Tables of drive gains, effort scales, offsets, parameters per run, and scatter of estimates."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import Array
from steelyard.estimate.bootstrap_and_sensitivity import (
    Bootstrap,
    RepeatedEstimates,
    Sensitivity,
    Variation,
)
from steelyard.estimate.nonlinear.effort_scales import EffortScales
from steelyard.estimate.nonlinear.nonlinear_parameters import ZeroOffsets
from steelyard.estimate.payload.drive_gains import DriveGain, GainEstimate
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import PageContent, TableSection, ValueSection
from steelyard.report.tables import PlainTable, Row, table_of, text_table
from steelyard.report.words import count, percent, rounded_to_uncertainty, significant

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
    ValueSection,
    name="effort_scales",
    title="Scales of the efforts",
    value="scales",
    field="effort_scales",
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
        values = zip(
            found.joints, found.found.values.tolist(), found.half_width.tolist(), strict=True
        )
        rows = [
            Row((joint, rounded_to_uncertainty(x, half), f"± {significant(half, 2)}"))
            for joint, x, half in values
        ]
        return (PlainTable("", words, ("Joint", "Scale", "95 % interval"), rows, (0,)),)


class ZeroOffsetsSection(
    ValueSection, name="zero_offsets", title="Zero offsets", value="offsets", field="zero_offsets"
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


MOST_NAMED_SCATTERS = 3  # in the terminal
LEAST_MARKED_RATIO = 2.0  # ratio of the two standard deviations from which on a row is marked


class BootstrapSection(
    ValueSection, name="bootstrap", title="Bootstrap over time windows", value="bootstrap"
):
    """Stated and drawn standard deviations of every parameter."""

    def tables_of(self, found: Bootstrap, content: ReportContent) -> Sequence[PlainTable]:
        """One row per parameter; those that scatter far more than was stated are marked."""
        return (_bootstrap_table(found, content.identified.estimate.std),)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How the scatter of drawn windows compares with the stated uncertainty."""
        found = content.bootstrap
        if found is None:
            return
        over, names = _ratios(found, content.identified.estimate.std), found.parameters.names
        order = np.argsort(-np.nan_to_num(over))[:MOST_NAMED_SCATTERS]
        most = ", ".join(f"{names[k]} {significant(float(over[k]))}" for k in order)
        lines = [
            f"bootstrap: {len(found.draws)} draws of {count(found.windows, 'window')} scatter by "
            f"{significant(float(np.nanmedian(over)))} of the stated standard deviation in the "
            "median",
            f"largest ratios: {most}; {int(np.sum(over > LEAST_MARKED_RATIO))} of {len(over)} "
            f"above {LEAST_MARKED_RATIO:g}",
        ]
        if found.failed:
            lines.append(f"{count(found.failed, 'draw')} gave no estimate")
        yield Text("\n".join(lines))


def _ratios(found: Bootstrap, stated: Array) -> Array:
    """Scatter of each parameter over its stated standard deviation, shape `(p,)`."""
    unknown = np.full(len(stated), np.nan)
    return np.asarray(np.divide(found.std, stated, out=unknown, where=stated > 0.0))


def _bootstrap_table(found: Bootstrap, stated: Array) -> PlainTable:
    own, over = found.parameters, _ratios(found, stated)
    columns = np.column_stack([own.values, stated, found.std, over, *found.interval()])
    rows = [
        Row((name, *map(significant, numbers), unit), bool(ratio > LEAST_MARKED_RATIO))
        for name, unit, numbers, ratio in zip(
            own.names, own.units, columns.tolist(), over, strict=True
        )
    ]
    failed = f" {found.failed} draws gave no estimate." if found.failed else ""
    return PlainTable(
        f"{len(found.draws)} draws of {found.windows} windows",
        "Windows of every run are resampled with replacement, and the whole estimate is repeated."
        f"{failed} Where its scatter exceeds {LEAST_MARKED_RATIO:g} times the stated std "
        "(bold), windows "
        "disagree, so the model is incomplete there, or a body lies at the boundary of physical "
        "consistency, where the stated interval is too narrow. Parameters constrained by the prior "
        "scatter less than their uncertainty.",
        ("Parameter", "Value", "Stated std", "Bootstrap std", "Ratio", "2.5 %", "97.5 %", "Unit"),
        rows,
        (0, 7),
    )


REPEATED_TITLE = "Estimates from each log alone"


class RepeatedSection(ValueSection, name="repeated", title=REPEATED_TITLE, value="repeated"):
    """Mean and standard deviation of every parameter over the logs."""

    def tables_of(self, found: RepeatedEstimates, content: ReportContent) -> Sequence[PlainTable]:
        """One row per parameter."""
        return (repeated_table(found),)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The table, as it was asked for."""
        for table in self.tables(content):
            yield text_table(table, self.title)


def repeated_table(found: RepeatedEstimates) -> PlainTable:
    """One row per parameter; a parameter that some estimations do not identify has their number."""
    every = len(found.labels)

    def name(row: Mapping[str, Any]) -> str:
        known: str = row["name"]
        return known if row["count"] == every else f"{known} ({row['count']} of {every})"

    return table_of(
        found.rows(),
        {
            "Parameter": name,
            "Mean": lambda row: significant(row["mean"]),
            "Std": lambda row: significant(row["std"]),
            "Relative": lambda row: percent(row["relative_percent"]),
            "Stated std": lambda row: significant(row["stated_std"]),
            "Unit": lambda row: str(row["unit"]),
        },
        caption=f"{REPEATED_TITLE}: {count(every, 'estimation')}",
        words=f"Mean and {found.deviation} standard deviation over {', '.join(found.labels)}, "
        "beside the root mean square of the stated standard deviations. A prior that all "
        "estimations share reduces their scatter.",
        text=(0, 5),
        note=f"std: {found.deviation}; relative: over the mean; stated std: root mean square of "
        "those stated by the estimations",
    )


MOST_NAMED_MOVES = 10  # parameters that are named: those that move most


class SensitivitySection(
    ValueSection, name="sensitivity", title="Sensitivity to the cut-offs", value="sensitivity"
):
    """Fits with other cut-offs, and the parameters that move most between them."""

    def tables_of(self, found: Sensitivity, content: ReportContent) -> Sequence[PlainTable]:
        """The fits, and the parameters that move most."""
        return _fits_table(found), _moved(found)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The fits, and which parameters move most between them."""
        found = content.sensitivity
        if found is None:
            return

        yield text_table(_fits_table(found), self.title)
        order = np.argsort(-found.spread)[:MOST_NAMED_MOVES]
        most = ", ".join(f"{found.parameters.names[k]} {found.spread[k]:.1f}" for k in order)
        yield Text(f"largest parameter shifts, in standard deviations: {most}")


def _fits_table(found: Sensitivity) -> PlainTable:
    """One row per fit."""

    def shift(fit: Variation) -> str:
        median = found.median_shift(fit)
        return "" if median is None else significant(median)

    return table_of(
        found.rows,
        {
            "Cut-offs": lambda fit: f"x {fit.factor:g}",
            "Motion": lambda fit: f"{fit.motion:g} Hz",
            "Regression": lambda fit: f"{fit.matched:g} Hz",
            "Fit error": lambda fit: fit.failed or _percent(fit.fitted),
            "Validation error": lambda fit: _percent(fit.unseen),
            "Median shift [std]": shift,
        },
        caption="Fits with other cut-offs",
        words="The same laws, nonlinear parameters and gains; errors are of the kind and the band "
        "of the verdict's headline in every row. A result that other cut-offs change by many "
        "standard deviations depends on the choice of cut-offs, not on the data alone.",
        marked=lambda fit: fit is found.result,
    )


def _moved(found: Sensitivity) -> PlainTable:
    names, spread = found.parameters.names, found.spread
    return table_of(
        np.argsort(-spread)[:MOST_NAMED_MOVES].tolist(),
        {
            "Parameter": lambda k: names[k],
            "Largest shift [std]": lambda k: significant(float(spread[k])),
        },
        caption="Largest parameter shifts",
        words="Largest distance of any of these fits from the result, in standard deviations.",
    )


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} %"

"""External wrench along a log, without a force sensor: `steelyard wrench`, with its page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import Array
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.external import wrench_methods_and_observer_step as methods
from steelyard.estimate.external.wrench_methods_and_observer_step import (
    FORCE,
    LEVER,
    Axes,
    moved_frame,
)
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.identify.runs_and_notes_of_logs import left_out, notes_of, runs_for, was_fitted
from steelyard.logs.formats import open_log, write_table
from steelyard.report.page import figures, notes, page_of
from steelyard.report.page_figures import Figure, Group, Key, Traced, area, evenly, line
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import NONE, significant
from steelyard.runs.runs_of_named_logs import log_file
from steelyard.uses.control.feedforward import refuse_unknown_gains
from steelyard.uses.wrench import measured_wrench_and_sensor_mounting as sensors
from steelyard.uses.wrench.measured_wrench_and_sensor_mounting import SensorSign
from steelyard.uses.wrench.wrench_along_run import (
    COMPONENTS,
    ResidualKind,
    WrenchEstimate,
    estimated_wrench,
    name_of,
)
from steelyard.uses.wrench.wrench_kalman_smoother import (
    DURATION,
    OBSERVABLE,
    Smoothed,
    WrenchMethod,
)

MOST_POINTS_OF_WRENCH = 3000  # points of a line, at most
LEAST_LASTING_SHARE = 1.0 / 3.0  # of the log with a force: something else is likelier than pushes
LEAST_UNEXPECTED_FORCE = 5.0  # over the expected one: something else is likelier than a push
LEAST_VARIANCE_SHARE = 0.005  # of the expected variance, below which nothing is estimated

PARTLY_EXPECTED = "along unobservable directions by the expected size"
NOT_CONTAINED = "along observable directions alone"

SOURCES = {
    "momentum": "generalised momentum, without accelerations",
    "torque": "measured minus predicted torque",
}

METHODS = {
    "smoothed": "smoothed over time, errors of the model's parameters estimated from the same log",
    "weighted": "each sample by itself, weighted by the model's uncertainty and the expected size",
    "inverse": "inverse of the transposed Jacobian: large near singular postures",
}


@dataclass(frozen=True)
class ComponentSummary:
    """One component of the wrench over a log; values are in its unit."""

    component: str
    unit: str
    rms: float
    peak: float
    peak_half_width: float  # half-width of its 95 % interval
    peak_time_s: float
    median_half_width: float
    nonzero_share: float  # share of the samples whose interval leaves zero out
    data_share: float  # share of the expected variance that the log removes, on average
    assumed_zero: bool  # whether it is not estimated but zero, as its expected size is

    @property
    def row(self) -> Row:
        """For people to read; without estimates where it has none."""
        name = f"{self.component.replace(' along', '').replace(' about', '')} [{self.unit}]"
        width = f"± {significant(self.median_half_width, 2)}"
        if self.assumed_zero:
            return Row((name, NONE, "assumed zero", NONE, NONE, NONE, NONE))
        if self.data_share < LEAST_VARIANCE_SHARE:
            return Row((name, NONE, NONE, NONE, width, NONE, "0 %"))
        peak = f"{significant(self.peak)} ± {significant(self.peak_half_width, 2)}"
        shares = (f"{100.0 * share:.0f} %" for share in (self.nonzero_share, self.data_share))
        at = f"{self.peak_time_s:.2f}"
        return Row((name, significant(self.rms), peak, at, width, *shares))


@dataclass(frozen=True, eq=False, repr=False)
class ExternalWrench(Result):
    """External wrench along a log."""

    robot: str
    estimate: WrenchEstimate  # all arrays
    usual_bandwidth: float  # cut-off of the model's scores [Hz]
    fitted: bool
    left_out: tuple[str, ...]  # rows and times that were not examined, for people to read
    details: tuple[str, ...]
    measured: sensors.MeasuredWrench | None = None  # by a force/torque sensor, if one is named
    json_name = "wrench.json"

    @property
    def headline(self) -> str:
        """The largest force that differs from zero, or that none does."""
        found, at = self.estimate, self.estimate.largest
        ends = (found.force_lower[at], found.force_upper[at])
        low, high = (significant(float(x)) for x in ends)
        size = significant(float(found.force[at]))
        inverse = found.method == methods.InverseJacobian.name
        lacks = np.isinf(found.condition[at]) if inverse else not found.force_observable[at]
        remark = f", {NOT_CONTAINED if inverse else PARTLY_EXPECTED}" if lacks else ""
        text = f"{size} N (95 %: {low} to {high} N{remark})"
        place = f"at {found.t[at]:.2f} s of {found.run} ({found.t[-1] - found.t[0]:.1f} s)"
        if found.pushed[at]:
            return f"Largest force on {found.frame}: {text} {place}"
        return (
            f"No force on {found.frame} that differs from zero (95 %); largest estimate "
            f"{text} {place}"
        )

    @property
    def claim(self) -> str:
        """What was estimated, and how."""
        found = self.estimate
        axes = f"axes of {found.frame}" if found.axes == "frame" else "axes of the base"
        return (
            f"Wrench on the robot, moments about the origin of {found.frame}, {axes}. External "
            f"torques: {SOURCES[found.residual]}, low-pass {found.bandwidth:.3g} Hz. Wrench: "
            f"{METHODS[found.method]}. Intervals: 95 %."
        )

    @property
    def settings(self) -> str:
        """The same in short."""
        found = self.estimate
        axes = found.frame if found.axes == "frame" else "the base"
        return (
            f"On the robot, moments about the frame's origin, axes of {axes}; 95 % intervals; "
            f"{found.method}, by the {found.residual}, low-pass {found.bandwidth:.3g} Hz"
        )

    @property
    def components(self) -> tuple[ComponentSummary, ...]:
        """Figures of the six components."""
        found = self.estimate
        highest = np.argmax(np.abs(found.wrench), axis=0).tolist()
        return tuple(
            ComponentSummary(
                component=component,
                unit=unit,
                rms=float(np.sqrt(np.mean(np.square(found.wrench[:, k])))),
                peak=float(found.wrench[at, k]),
                peak_half_width=float(found.half_width[at, k]),
                peak_time_s=float(found.t[at]),
                median_half_width=float(np.median(found.half_width[:, k])),
                nonzero_share=float(np.mean(np.abs(found.wrench[:, k]) > found.half_width[:, k])),
                data_share=float(np.mean(found.data_share[:, k])),
                assumed_zero=bool(found.assumed_zero[k]),
            )
            for k, (component, unit, at) in enumerate(
                zip(COMPONENTS, sensors.UNITS, highest, strict=True)
            )
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What qualifies the result."""
        found, warnings = self.estimate, list(self.left_out)
        if self.measured is not None:
            warnings += self.measured.warnings
        inverse = found.method == methods.InverseJacobian.name
        if found.unobservable:
            shares = ((name_of(x), 100.0 * found.unobservable_share(x)) for x in found.unobservable)
            names = "; ".join(f"{name} ({share:.0f} % of the log)" for name, share in shares)
            warnings.append(
                f"not observable from the joint torques of this log: {names}. "
                + (
                    "There the inverse multiplies errors, and gives zero with too narrow an "
                    "interval where the Jacobian has no inverse"
                    if inverse
                    else "There the estimate stays near zero, with an interval of 1.4 to 2 times "
                    "the expected size on either side"
                )
            )
        elif found.partly_unobservable > 0.0:
            at = found.least_data_share < OBSERVABLE
            worst = COMPONENTS[int(np.argmin(found.data_share[at].mean(axis=0)))]
            warnings.append(
                "one direction or more is not observable in "
                f"{100.0 * found.partly_unobservable:.2g} % of the log, near singular "
                f"postures (mostly {worst}): "
                + ("the inverse multiplies errors there" if inverse else "intervals there are wide")
            )
        if found.bandwidth < self.usual_bandwidth:
            warnings.append(
                f"the low-pass of {found.bandwidth:.3g} Hz hides pushes shorter than "
                f"{0.5 / found.bandwidth:.2g} s (usual for this model: {self.usual_bandwidth:.3g} "
                "Hz, for logs of at least ten times that rate)"
            )
        if self.fitted:
            warnings.append("the model was fitted to this log: its residuals are too small")
        lasting, doubts = float(np.mean(found.pushed)), []
        times = float(found.force[found.largest]) / found.expected.force
        if lasting > LEAST_LASTING_SHARE:
            doubts.append(f"the force differs from zero in {100.0 * lasting:.0f} % of the log")
        if found.pushed[found.largest] and times > LEAST_UNEXPECTED_FORCE:
            doubts.append(
                f"the largest force is {significant(times, 2)} times the expected "
                f"{found.expected.force:g} N"
            )
        if doubts:
            warnings.append(
                f"{', '.join(doubts)}: efforts in other units or with another sign, other "
                "positions, a payload, another tool or other drive gains are likelier than pushes; "
                "steelyard check names what differs, steelyard payload identifies a payload"
            )
        return tuple(warnings)

    @property
    def t(self) -> Array:
        """Time from the log's start, shape `(N,)` [s]."""
        return self.estimate.t

    @property
    def wrench(self) -> Array:
        """Force [N] and moment [Nm] on the robot, shape `(N, 6)`."""
        return self.estimate.wrench

    @property
    def half_width(self) -> Array:
        """Half-width of the 95 % intervals of `wrench`, shape `(N, 6)`."""
        return self.estimate.half_width

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Directions that the joints do not show in this log."""
        return tuple(name_of(direction) for direction in self.estimate.unobservable)

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        found = self.estimate
        components, least, torques = _figures(found, self.measured)
        over_time = Group(components, columns="one")
        tables = [components_table(self)]
        legend = [Key("--measured", "estimate"), Key("--interval", "95 % interval", "area")]
        if self.measured is not None:
            tables.append(self.measured.table())
            legend.append(Key("--predicted", "sensor"))
        sections = (
            figures("wrench", "Wrench", words=f"{self.headline}. {self.claim}", tables=tables),
            notes("notes", "Limits of this result", self.warnings),
            figures("over-time", "Wrench over time", legend=legend, groups=[over_time]),
            figures(
                "observability",
                "Observability",
                words="Share of the expected variance that the log removes, in the direction where "
                f"it removes least; below {OBSERVABLE:g} that direction counts as not observable.",
                groups=[Group([least], columns="one")],
            ),
            figures(
                "torques",
                "External torques",
                legend=[
                    Key("--measured", "external torque"),
                    Key("--interval", "95 % interval of the model's error", "area"),
                ],
                groups=[Group(torques, columns="one")],
            ),
            notes("details", "Notes", self.details, folded=True),
        )
        return page_of(f"{self.robot}: wrench in {found.run}", self.robot, sections)

    def to_dict(self) -> dict[str, Any]:
        """What was estimated as JSON values, without the samples."""
        found, at = self.estimate, self.estimate.largest
        return {
            "log": found.run,
            "frame": found.frame,
            "axes": found.axes,
            "residual": found.residual,
            "method": found.method,
            "bandwidth_hz": found.bandwidth,
            "expected": {"force_N": found.expected.force, "lever_m": found.expected.lever},
            "largest_force": {
                "force_N": float(found.force[at]),
                "low_N": float(found.force_lower[at]),
                "high_N": float(found.force_upper[at]),
                "observable": bool(found.force_observable[at]),
                "time_s": float(found.t[at]),
                "differs_from_zero": bool(found.pushed[at]),
            },
            "samples": len(found.t),
            "start_s": float(found.t[0]),
            "end_s": float(found.t[-1]),
            "components": [vars(row) for row in self.components],
            "measured": None if self.measured is None else self.measured.to_dict(),
            "unobservable": [
                {
                    "name": name_of(one),
                    **dict(zip(COMPONENTS, one.tolist(), strict=True)),
                    "share_of_log": found.unobservable_share(one),
                }
                for one in found.unobservable
            ],
            "partly_unobservable_share": found.partly_unobservable,
            "warnings": list(self.warnings),
            "notes": list(self.details),
        }

    def table(self) -> dict[str, Array]:
        """Columns of `wrench.csv`: time, wrench, half-widths, external efforts, data share.

        With a sensor, what it measured too.
        """
        found = self.estimate
        joints = zip(found.joints, found.units, strict=True)
        names = (
            *sensors.WRENCH_TABLE_COLUMNS,
            *(f"half_width_{name}" for name in sensors.WRENCH_TABLE_COLUMNS),
            *(f"external_{joint}_{unit}" for joint, unit in joints),
        )
        own = np.hstack([found.wrench, found.half_width, found.torque]).T
        columns = dict(zip(names, own, strict=True))
        table = {"time_s": found.t, **columns, "least_data_share": found.least_data_share}
        if self.measured is not None:
            measured = zip(sensors.WRENCH_TABLE_COLUMNS, self.measured.wrench.T, strict=True)
            table |= {f"measured_{name}": own for name, own in measured}
        return table

    def write(self, folder: Path) -> None:
        """Write `report.html`, `wrench.csv` and `wrench.json`."""
        super().write(folder)
        write_table(folder / "wrench.csv", self.table())

    def show(self, console: Console) -> None:
        """Print the components and what qualifies them."""
        print_verdict(console, self.headline, self.settings, self.warnings)
        console.print(narrow_table(components_table(self)))
        if self.measured is not None:
            table = self.measured.table()
            console.print(Text(f"\n{table.words}"))
            console.print(narrow_table(table))


def components_table(content: ExternalWrench) -> PlainTable:
    """One row per component."""
    words = (
        "From data: share of the expected variance (standard deviation "
        f"{content.estimate.expected.force:.3g} N, moments {content.estimate.expected.lever:.2g} m "
        "times that) that the log removes, mean over time."
    )
    headings = ("", "RMS", "largest", "at [s]", "± (median)", "not zero", "from data")
    return PlainTable("", words, headings, [one.row for one in content.components])


def _figures(
    found: WrenchEstimate, measured: sensors.MeasuredWrench | None
) -> tuple[list[Figure], Figure, list[Figure]]:
    at = evenly(len(found.t), MOST_POINTS_OF_WRENCH)
    t, components, torques = found.t[at], [], []
    for k, (name, unit) in enumerate(zip(COMPONENTS, sensors.UNITS, strict=True)):
        own, half = found.wrench[at, k], found.half_width[at, k]
        interval = area("95 % interval", t, own - half, own + half, "--interval")
        estimate = line("estimate", t, own, "--measured", width=1.5)
        traces = [interval, estimate]
        if measured is not None:
            sensor = measured.wrench[at, k]
            traces.append(line("sensor", t, sensor, "--predicted", width=1.2, dash="dash"))
        y = f"{name.split()[0]} [{unit}]"
        components.append(_figure(name.capitalize(), y, traces))
    for j, (joint, unit) in enumerate(zip(found.joints, found.units, strict=True)):
        half = found.torque_half_width[at, j]
        interval = area("95 % interval of the model's error", t, -half, half, "--interval")
        estimate = line("external torque", t, found.torque[at, j], "--measured", width=1.2)
        torques.append(_figure(joint, f"effort [{unit}]", [interval, estimate]))
    limit = line("limit", t, np.full(len(t), OBSERVABLE), "--vermillion", width=1, dash="dash")
    share = line("share", t, found.least_data_share[at], "--measured", width=1.5)
    least = _figure("Least observable direction", "share", [share, limit], yaxis={"range": [0, 1]})
    return components, least, torques


def _figure(title: str, y: str, traces: list[Traced], **layout: object) -> Figure:
    more = {"showlegend": False, **layout}
    return Figure(title, f"{title} over time", "time [s]", y, traces, more, height=220)


MethodName = Literal["smoothed", "weighted", "inverse"]


@checked()
def external_wrench(
    model: str | Path | IdentifiedModel,
    log: str | Path,
    frame: str | None = None,
    *,
    residual: ResidualKind | None = None,
    method: MethodName = "smoothed",
    bandwidth: float | None = None,
    force: float = FORCE,
    lever: float = LEVER,
    duration: float = DURATION,
    axes: Axes = "frame",
    measured: str | Sequence[str] = (),
    sensor: str | None = None,
    sensor_at: str | Sequence[float] = (),
    sensor_sign: SensorSign = "on_robot",
    sensor_rest: Sequence[str] = (),
    progress: Progress = silent,
) -> ExternalWrench:
    """Estimate the wrench that acts on a frame along a log, with 95 % intervals.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        log: The log; `run.csv@5:20` is a window in seconds.
        frame: Frame that the wrench acts on; that of the robot's end if `None`.
        residual: What external torques are computed from; if `None` the momentum, which needs no
            accelerations, or the torque with a floating base, whose velocity is not logged.
        method: `smoothed` over time, with errors of the model estimated from the same log;
            `weighted` by the uncertainty of the model and the expected wrench, each sample by
            itself; `inverse`, by the transposed Jacobian's inverse.
        bandwidth: Low-pass of external torques [Hz]; if `None`, the validation cutoff of the robot
            file or else the regression cut-off, or a tenth of the log's rate if that is less.
        force: Expected size of each component of the force [N], 0.1 to 100 000.
        lever: Expected moment over expected force [m], up to 100; 0 for forces at the frame's
            origin, moments then count as zero.
        duration: Usual duration of a push [s], for `smoothed`.
        axes: Axes of the components.
        measured: The log's columns of a force/torque sensor, with which the estimate is compared:
            force x, y, z [N], then moment x, y, z [Nm]; or a pattern such as `ft_{}`; or `auto` for
            `fx_N` to `tz_Nm` and other usual names.
        sensor: Link or frame of the sensor, on the same link as `frame`; `frame` if `None`.
        sensor_at: Place of the sensor in that frame, if it is another: x, y, z [m] and, if it is
            turned, roll, pitch, yaw [rad], such as "0 0 0.05 0 0 1.57".
        sensor_sign: Whether the sensor reads the wrench on the robot or that by the robot.
        sensor_rest: Stretches START:STOP from the log's start [s] where the robot rests and nothing
            touches the sensor. Its bias is estimated there and, if it is turned between them, the
            weight of what it carries; of the rest at the start, the bias alone.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, the frame is fixed to the base, the log is too slow
            or short for the bandwidth, or its efforts are not those of the model's robot.

    Example:
        >>> found = external_wrench("arm-model", "other.csv", "lower")
        >>> found.wrench.shape == found.half_width.shape == (len(found.t), 6)
        True
    """
    identified = load_model(model)
    refuse_unknown_gains(identified)
    moved_frame(identified.robot, frame)
    expected = methods.Expected(force, lever)
    chosen: WrenchMethod
    if method == "smoothed":
        chosen = Smoothed(expected, duration)
    else:
        chosen = (methods.Weighted if method == "weighted" else methods.InverseJacobian)(expected)
    file = log_file(str(log))
    columns = [measured] if isinstance(measured, str) else list(measured)
    if columns:
        named = sensors.sensor_columns(open_log(file.path).columns, columns, file.text)
        base = moved_frame(identified.robot, sensor or frame)
        rest = tuple(map(sensors.stretch_of_rest, sensor_rest))
        reader = sensors.Sensor(named, base, sensors.sensor_placement(sensor_at), sensor_sign, rest)
    elif sensor is not None or sensor_at or sensor_sign != "on_robot" or sensor_rest:
        wrong = "a sensor is described, but none of its columns is named"
        fix = "name the six columns of the force/torque sensor with --measured"
        raise DataError(wrong, where=file.text, fix=fix)
    (run,) = runs_for(identified, [file], progress, at_rest=True)
    estimate = estimated_wrench(
        identified,
        run,
        frame,
        residual=residual,
        method=chosen,
        bandwidth=bandwidth,
        axes=axes,
        window=file.cut.seconds,
        progress=progress,
    )
    return ExternalWrench(
        robot=identified.robot.name,
        estimate=estimate,
        usual_bandwidth=identified.cutoffs.score,
        fitted=was_fitted(identified, file, run),
        left_out=left_out(run),
        details=notes_of([run]),
        measured=sensors.measured_wrench(identified, run, file, reader, estimate)
        if columns
        else None,
    )

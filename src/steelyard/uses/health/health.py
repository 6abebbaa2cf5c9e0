"""What drifted in a robot, from logs of its operation: `steelyard health`, with its page."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import Z95, by_key
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    residual_cutoff,
    residual_trace,
)
from steelyard.identify.runs_and_notes_of_logs import notes_of, runs_for
from steelyard.report.page import figures, notes, page_of
from steelyard.report.page_figures import Figure, Group, Key, area, line
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import NONE
from steelyard.runs.runs_of_named_logs import log_files, paths_of, refuse_overlaps
from steelyard.uses.effort_plausibility import refuse_other_efforts
from steelyard.uses.health import drift_detection as drift
from steelyard.uses.payload.payload_fit import unknown_payload

BLIND = 1.0  # relative half-width of all quantities of a joint above which nothing is decided
QUANTITY_HEADINGS = ("dry", "viscous", "offset", "effort scale")  # as short as columns need


@dataclass(frozen=True, eq=False, repr=False)
class Health(Result):
    """Friction, offsets and effort scales of a robot over windows and logs."""

    robot: str
    joints: Sequence[str]
    logs: tuple[str, ...]  # names of the logs, in the order of time
    series: tuple[drift.Series, ...]
    changes: tuple[drift.HealthChange, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    json_name = "health.json"

    @property
    def drifts(self) -> tuple[drift.HealthChange, ...]:
        """What drifted, the most certain first: significant and large enough."""
        return tuple(change for change in self.changes if change.matters)

    @property
    def unproven(self) -> tuple[drift.HealthChange, ...]:
        """What differs by far from the model, or between logs too short to prove a drift."""
        drifted = {(change.joint, change.quantity) for change in self.drifts}
        return tuple(c for c in self.changes if c.unproven and (c.joint, c.quantity) not in drifted)

    @property
    def named(self) -> tuple[drift.HealthChange, ...]:
        """Drifts and unproven changes; of one within or over logs, not that it differs too."""
        found = (*self.drifts, *self.unproven)
        timed = {(c.joint, c.quantity) for c in found if c.shape != "differs"}
        return tuple(c for c in found if c.shape != "differs" or (c.joint, c.quantity) not in timed)

    @property
    def headline(self) -> str:
        """How much drifted."""
        drifted, differ = ({c.joint for c in some} for some in (self.drifts, self.unproven))
        logs = self.logs[0] if len(self.logs) == 1 else f"{len(self.logs)} logs"
        if drifted:
            return f"{len(drifted)} of {len(self.joints)} joints drifted in {logs}"
        if differ:
            return f"{len(differ)} of {len(self.joints)} joints differ in {logs}, drift not proven"
        blind = f", which cannot decide for {', '.join(self.blind)}" if self.blind else ""
        return f"No drift in {logs}{blind}"

    @property
    def blind(self) -> tuple[str, ...]:
        """Joints of which the logs would show no change, not even one by `BLIND` times."""
        widths = by_key((c.joint, c.half_width) for c in self.changes if not c.unit)
        return tuple(joint for joint, known in widths.items() if min(known) > BLIND)

    @property
    def limits(self) -> tuple[str, ...]:
        """What qualifies the result."""
        if not self.unproven:
            return self.warnings
        by = by_key((change.joint, change.quantity) for change in self.unproven)
        logs = "one log" if len(self.logs) == 1 else f"these {len(self.logs)} logs"
        joints = "; ".join(f"{joint} ({', '.join(dict.fromkeys(x))})" for joint, x in by.items())
        return (
            f"{logs} cannot tell drift from an error of the model in other motions or from other "
            f"efforts; beyond {drift.CLEAR_HALF_WIDTHS:g} half-widths: {joints}. Give longer logs, "
            "or several",
            *self.warnings,
        )

    @property
    def claim(self) -> str:
        """What counts as a drift."""
        false, least = 100.0 * drift.FALSE_DRIFT_LEVEL, drift.LEAST_CHANGE
        return (
            f"A drift is significant (probability of any false one {false:.0f} %, "
            f"{len(self.changes)} changes tested) and changes friction by "
            f"{100.0 * least['dry friction']:.0f} %, the effort scale by "
            f"{100.0 * least['effort scale']:.0f} % or an offset by "
            f"{100.0 * least['offset']:.0f} % of the joint's friction, at least."
        )

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        found = []
        for joint in self.joints:
            mine = [one for one in self.series if one.joint == joint]
            drifts = [change for change in self.named if change.joint == joint]
            words = "; ".join(f"{change.quantity} {change.text}" for change in drifts)
            if mine:
                found.append(Group([_figure(one) for one in mine], joint, words or "no drift"))
        words = f"{self.headline}. {self.claim}"
        tables = [drifts_table(self)] if self.named else []
        sections = (
            figures("drift", "Drift", words=words, tables=tables),
            notes("limits", "Limits of this result", self.limits),
            figures("joints", "Joints", tables=[joints_table(self)]),
            figures(
                "windows",
                "Changes over time",
                legend=[Key("--measured", "windows"), Key("--interval", "95 % interval", "area")],
                groups=found,
                note="Change from the model of every window; logs follow each other without the "
                f"time between them. Lines are interrupted between logs: {', '.join(self.logs)}.",
            ),
            notes("notes", "Notes", self.notes, folded=True),
        )
        return page_of(f"{self.robot}: health", self.robot, sections)

    def to_dict(self) -> dict[str, Any]:
        """What drifted, what was tested, and the values of all windows as JSON values."""
        return {
            "logs": list(self.logs),
            "drifts": [change.to_dict() for change in self.drifts],
            "unproven": [change.to_dict() for change in self.unproven],
            "tested": [change.to_dict() for change in self.changes],
            "windows": [
                {
                    "joint": one.joint,
                    "quantity": one.quantity,
                    "unit": one.unit or None,
                    "log": [self.logs[int(k)] for k in one.log],
                    "t_s": one.t.tolist(),
                    "change": one.value.tolist(),
                    "std": one.std.tolist(),
                }
                for one in self.series
            ],
            "warnings": list(self.limits),
            "notes": list(self.notes),
        }

    def show(self, console: Console) -> None:
        """Print what drifted, and one line per joint."""
        print_verdict(console, self.headline, self.claim, self.limits)
        if self.named:
            console.print(narrow_table(drifts_table(self)))
        table = joints_table(self)
        console.print(Text(f"\n{table.words}"))
        joints = narrow_table(table)
        joints.columns[0].no_wrap = True
        console.print(joints)


def drifts_table(content: Health) -> PlainTable:
    """One row per drift or unproven change."""
    cells = ((x.joint, x.quantity, x.text, x.when, chance(x.p)) for x in content.named)
    rows = list(map(Row, cells))
    return PlainTable("", "", ("joint", "what", "change ± 95 %", "when", "p"), rows, (0, 1, 3))


def chance(p: float) -> str:
    """A probability for people to read."""
    return "< 1e-6" if p < 1e-6 else f"{p:.1g}"


def joints_table(content: Health) -> PlainTable:
    """One row per joint: the level in the last log against the model, marked where it drifted."""
    marks = {(c.joint, c.quantity): " ?" for c in content.unproven}
    marks |= {(c.joint, c.quantity): " !" for c in content.drifts}
    levels = [c for c in content.changes if c.shape == "differs"]
    places = [(c.joint, c.quantity) for c in levels]
    last = {at: f"{c.text}{marks.get(at, '')}" for at, c in zip(places, levels, strict=True)}
    rows = [Row((x, *(last.get((x, q), NONE) for q in drift.QUANTITIES))) for x in content.joints]
    words = "Level in the last log relative to the model, with its 95 % interval; ! drift"
    words += "; ? differs, drift not proven." if content.unproven else "."
    return PlainTable("", words, ("joint", *QUANTITY_HEADINGS), rows)


def _figure(one: drift.Series) -> Figure:
    """Windows of one quantity, the logs one after another."""
    factor, unit = (1.0, one.unit) if one.unit else (100.0, "%")
    traces, start = [], 0.0
    for _, times, values, stds in one.by_log():
        t = (start + times) / 60.0
        value, half = factor * values, factor * Z95 * stds
        traces += [
            area("95 %", t, value - half, value + half, "--interval"),
            line("window", t, value, "--measured", mode="lines+markers", marker={"size": 4}),
        ]
        start += float(times.max())
    label = f"Change of the {one.quantity} of {one.joint} over time"
    return Figure(
        one.quantity, label, "time in logs [min]", f"change [{unit}]", traces, {"showlegend": False}
    )


@checked()
def health(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    *,
    progress: Progress = silent,
) -> Health:
    """Detect drift of friction, offsets and effort scales over windows of logs.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        logs: Logs of normal operation, in the order of time.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, shows no joint's friction, or the effort of a joint
            has the reversed sign.

    Example:
        >>> found = health("arm-model", "other.csv")
        >>> found.drifts
        ()
    """
    identified = load_model(model)
    files = log_files(paths_of(logs, least=1))
    refuse_overlaps(files, [])
    runs = runs_for(identified, files, progress, at_rest=False)
    cutoff = residual_cutoff(identified, runs)
    sigma = np.asarray(identified.estimate.sigma)
    regressor, rests = base_regressor(identified.model), identified.model.has_memory
    threads, found, carried = os.cpu_count() or 1, [], []
    for run in runs:
        refuse_other_efforts(residual_trace(identified, run, cutoff), sigma, identified.joints)
        whole = gather(regressor, run, rests=rests, threads=threads, progress=progress)
        count = int(run.duration / drift.LEAST_WINDOW)
        found.append(whole.merged(max(1, min(drift.MOST_WINDOWS_OF_LOG, count))))
        carried.append(unknown_payload(identified, whole))
    series, names = drift.series_of(identified, found), [run.name for run in runs]
    if not series:
        wrong = "no window shows friction, offset and bodies of a joint separately"
        fix = "give longer logs, or motion in both directions at several speeds and postures"
        raise LogError(wrong, where=", ".join(names), fix=fix)
    robot = identified.model.robot
    return Health(
        robot=robot.name,
        joints=robot.joint_names,
        logs=tuple(names),
        series=series,
        changes=drift.changes_of(series, names),
        warnings=tuple(filter(None, carried)),
        notes=notes_of(runs),
    )

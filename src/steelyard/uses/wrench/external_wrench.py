"""External wrench along a log, without a force sensor: what `steelyard wrench` does."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from steelyard.base.arguments import checked
from steelyard.base.arrays import Array
from steelyard.base.files import write_table
from steelyard.base.progress import Progress, silent
from steelyard.estimate.external.effort_to_wrench import (
    FORCE,
    LEVER,
    Expected,
    InverseJacobian,
    Weighted,
    WrenchMethod,
)
from steelyard.estimate.external.observer_program import Axes, moved_frame
from steelyard.estimate.identified import IdentifiedModel, load_model
from steelyard.identify.run_notes import left_out, notes_of
from steelyard.identify.scores import fitted_before, runs_for
from steelyard.identify.validation_data import holds_fitted_rows
from steelyard.report.result import Result
from steelyard.runs.named_logs import log_files
from steelyard.uses.control.model_torques import refuse_unknown_gains
from steelyard.uses.wrench.wrench_along_run import (
    COMPONENTS,
    ResidualKind,
    WrenchEstimate,
    estimated_wrench,
    name_of,
)
from steelyard.uses.wrench.wrench_page import WrenchContent, render_wrench, wrench_lines
from steelyard.uses.wrench.wrench_smoothing import DURATION, Smoothed

if TYPE_CHECKING:
    from rich.console import Console


MethodName = Literal["smoothed", "weighted", "inverse"]

WRENCH_TABLE_COLUMNS = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
"""Force and moment in tables; `steelyard simulate --wrench` reads the same names."""


@dataclass(frozen=True, eq=False, repr=False)
class ExternalWrench(Result):
    """External wrench along a log.

    Attributes:
        content: All that the page shows.
    """

    content: WrenchContent
    json_name = "wrench.json"

    @property
    def estimate(self) -> WrenchEstimate:
        """All arrays."""
        return self.content.estimate

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
        return render_wrench(self.content)

    def to_dict(self) -> dict[str, Any]:
        """What was estimated as JSON values, without the samples."""
        found = self.estimate
        return {
            "log": found.run,
            "frame": found.frame,
            "axes": found.axes,
            "residual": found.residual,
            "method": found.method,
            "bandwidth_hz": found.bandwidth,
            "expected": {"force_N": found.expected.force, "lever_m": found.expected.lever},
            "largest_force": {
                "force_N": float(found.force[found.largest]),
                "half_width_N": float(found.force_half_width[found.largest]),
                "time_s": float(found.t[found.largest]),
                "differs_from_zero": bool(found.pushed[found.largest]),
            },
            "samples": len(found.t),
            "start_s": float(found.t[0]),
            "end_s": float(found.t[-1]),
            "components": [vars(row) for row in self.content.components],
            "unobservable": [
                {
                    "name": name_of(one),
                    **dict(zip(COMPONENTS, one.tolist(), strict=True)),
                    "share_of_log": found.unobservable_share(one),
                }
                for one in found.unobservable
            ],
            "partly_unobservable_share": found.partly_unobservable,
            "warnings": list(self.content.warnings),
            "notes": list(self.content.details),
        }

    def table(self) -> dict[str, Array]:
        """Columns of `wrench.csv`: time, wrench, half-widths, external efforts, data share."""
        found = self.estimate
        joints = zip(found.joints, found.units, strict=True)
        names = (
            *WRENCH_TABLE_COLUMNS,
            *(f"half_width_{name}" for name in WRENCH_TABLE_COLUMNS),
            *(f"external_{joint}_{unit}" for joint, unit in joints),
        )
        own = np.hstack([found.wrench, found.half_width, found.torque]).T
        columns = dict(zip(names, own, strict=True))
        return {"time_s": found.t, **columns, "least_data_share": found.least_data_share}

    def write(self, folder: Path) -> None:
        """Write `report.html`, `wrench.csv` and `wrench.json`."""
        super().write(folder)
        write_table(folder / "wrench.csv", self.table())

    def show(self, console: "Console") -> None:
        """Print the components and what qualifies them."""
        wrench_lines(self.content, console)


@checked()
def external_wrench(
    model: str | Path | IdentifiedModel,
    log: str | Path,
    frame: str | None = None,
    *,
    residual: ResidualKind = "momentum",
    method: MethodName = "smoothed",
    bandwidth: float | None = None,
    force: float = FORCE,
    lever: float = LEVER,
    duration: float = DURATION,
    axes: Axes = "frame",
    progress: Progress = silent,
) -> ExternalWrench:
    """Estimate the wrench that acts on a frame along a log, with 95 % intervals.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        log: The log; `run.csv@5:20` is a window in seconds.
        frame: Frame that the wrench acts on; that of the robot's end if `None`.
        residual: What external torques are computed from; the momentum needs no accelerations.
        method: `smoothed` over time, with errors of the model estimated from the same log;
            `weighted`, each sample by itself; `inverse`, by the transposed Jacobian's inverse.
        bandwidth: Low-pass of external torques [Hz]; if `None`, the validation cutoff of the robot
            file or else the regression cut-off, or a tenth of the log's rate if that is less.
        force: Expected size of each component of the force [N], 0.1 to 100 000.
        lever: Expected moment over expected force [m], up to 100; 0 for forces at the frame's
            origin, moments then count as zero.
        duration: Usual duration of a push [s], for `smoothed`.
        axes: Axes of the components.
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
    expected = Expected(force, lever)
    chosen: WrenchMethod
    if method == "smoothed":
        chosen = Smoothed(expected, duration)
    else:
        chosen = (Weighted if method == "weighted" else InverseJacobian)(expected)
    (file,) = log_files([str(log)])
    (run,) = runs_for(identified, [file], progress, at_rest=True)
    estimate = estimated_wrench(
        identified,
        run,
        frame,
        residual=residual,
        method=chosen,
        bandwidth=bandwidth,
        axes=axes,
        progress=progress,
    )
    content = WrenchContent(
        robot=identified.robot.name,
        estimate=estimate,
        usual_bandwidth=identified.cutoffs.score,
        fitted=fitted_before(identified, file) or holds_fitted_rows(identified, run),
        left_out=left_out(run),
        details=notes_of([run]),
    )
    return ExternalWrench(content)

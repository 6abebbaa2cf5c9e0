"""External wrench along a log, without a force sensor: what `steelyard wrench` does."""

from pathlib import Path
from typing import Literal

from steelyard.base.arguments import checked
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
from steelyard.runs.named_logs import log_files
from steelyard.uses.control.model_torques import refuse_unknown_gains
from steelyard.uses.wrench.wrench_along_run import ResidualKind, estimated_wrench
from steelyard.uses.wrench.wrench_page import ExternalWrench
from steelyard.uses.wrench.wrench_smoothing import DURATION, Smoothed

MethodName = Literal["smoothed", "weighted", "inverse"]


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
            `weighted` by the uncertainty of the model and the expected wrench, each sample by
            itself; `inverse`, by the transposed Jacobian's inverse.
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
    return ExternalWrench(
        robot=identified.robot.name,
        estimate=estimate,
        usual_bandwidth=identified.cutoffs.score,
        fitted=fitted_before(identified, file) or holds_fitted_rows(identified, run),
        left_out=left_out(run),
        details=notes_of([run]),
    )

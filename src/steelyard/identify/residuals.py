"""Efforts along a log, measured and predicted: what `steelyard.residuals` returns."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.gather import Mask
from steelyard.estimate.scores.effort_errors import (
    band_of,
    effort_reference,
    joints_moving,
    known_efforts,
)
from steelyard.estimate.scores.model_comparison import units_of
from steelyard.estimate.scores.score import low_passed, no_closed_sample
from steelyard.identify.runs_for_model import runs_for
from steelyard.report.result import DataFrame, frame
from steelyard.runs.runs_of_named_logs import log_file, paths_of


@dataclass(frozen=True, eq=False, repr=False)
class Residuals:
    """Efforts along a log, measured and predicted, both behind one zero-phase low-pass.

    Every sample is there from the first to the last motion. With estimated scales of the efforts,
    the measured ones are divided by them.
    """

    run: str  # name of the log
    joints: tuple[str, ...]  # names of the joints, in the order of the columns
    # unit of each joint's efforts: Nm or N; the logged unit without a known drive gain
    units: tuple[str, ...]
    cutoff: float  # of the low-pass [Hz]
    t: Array  # time, shape `(N,)` [s]
    measured: Array  # measured effort, shape `(N, n)`
    predicted: Array  # effort predicted by the model, shape `(N, n)`
    moving: Mask  # whether each joint moves by the log alone, shape `(N, n)`

    @property
    def residual(self) -> Array:
        """Measured minus predicted effort, shape `(N, n)`."""
        return self.measured - self.predicted

    @property
    def counted(self) -> Mask:
        """Samples that the errors are computed from, shape `(N, n)`.

        Where a joint moves; all of a joint that rests.
        """
        return self.moving | ~joints_moving(self.moving.sum(axis=0))

    @property
    def error(self) -> Array:
        """Root mean square of the residual over the `counted` samples, shape `(n,)`."""
        squares = np.where(self.counted, self.residual**2, 0.0)
        return np.asarray(np.sqrt(squares.sum(axis=0) / self.counted.sum(axis=0)))

    @property
    def table(self) -> DataFrame:
        """A Polars data frame with one row per sample and joint.

        Raises:
            PackageError: Polars is not installed.
        """
        count, n = self.measured.shape
        columns = {
            "t": np.repeat(self.t, n),
            "joint": list(self.joints) * count,
            "measured": self.measured.ravel(),
            "predicted": self.predicted.ravel(),
            "residual": self.residual.ravel(),
            "unit": list(self.units) * count,
            "moving": self.moving.ravel(),
        }
        return frame(columns, "residuals")

    def __repr__(self) -> str:
        errors = zip(self.joints, self.error, self.units, strict=True)
        listed = ", ".join(f"{joint} {error:.3g} {unit}" for joint, error, unit in errors)
        return f"Residuals({self.run}, below {self.cutoff:g} Hz: {listed})"


@checked()
def residuals(
    model: str | Path | IdentifiedModel,
    log: str | Path,
    *,
    cutoff: float | None = None,
    progress: Progress = silent,
) -> Residuals:
    """Measured and predicted efforts of a log, in the band and the unit of the printed errors.

    `error` is then what `identify` and `validate` print for each joint.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        log: The log; `run.csv@5:20` is a window in seconds.
        cutoff: Of the low-pass of measured and predicted efforts [Hz]; that of the printed errors
            (5 Hz, unless the robot file says otherwise) if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or the cut-off is too high for the log's rate.

    Example:
        >>> found = residuals("arm-model", "other.csv")
        >>> found.residual.shape == found.measured.shape == (len(found.t), 2)
        True
        >>> printed = validate("arm-model", "other.csv").scores["error"]
        >>> bool(abs(found.error - printed.to_numpy()).max() < 1e-9)
        True
    """
    if cutoff is not None and not cutoff > 0.0:
        raise DataError(
            f"a low-pass of {cutoff:g} Hz passes nothing",
            where="cutoff of residuals",
            fix="give a positive frequency, or None for that of the printed errors",
        )
    identified = load_model(model)
    (file,) = map(log_file, paths_of(log))
    (run,) = runs_for(identified, [file], progress)
    gains = identified.signals.gains
    band = band_of(effort_reference(identified), run.rate) if cutoff is None else cutoff
    found = [(x.t, x.counted, x.efforts) for x in low_passed([identified.valued], run, gains, band)]
    if not found:
        raise no_closed_sample(identified.valued, run)
    t, moving, efforts = (np.concatenate(some, axis=-1) for some in zip(*found, strict=True))
    measured, predicted = efforts * np.where(known_efforts(identified), gains, 1.0)[:, None]
    return Residuals(
        run.name,
        identified.joints,
        units_of(identified),
        band,
        frozen(t),
        frozen(measured.T),
        frozen(predicted.T),
        moving.T,
    )

r"""The cut-off of regression by what the model can describe: errors on left-out motion.

The band of a motion bounds what its torques can contain, not what a model explains of them: elastic
gears and controllers add what no rigid body has. Below each of some cut-offs, half of the one
before, least squares fits all data but one part, whose efforts are then predicted in one band.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.friction.friction_mixes import has_memory
from steelyard.estimate.identified_model import BAND
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.least_squares.weighted_and_recursive import WeightedLeastSquares
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.scores.cross_validation import (
    folding,
    left_out_errors,
    logarithms,
    per_fold,
    values_by,
)
from steelyard.model.model import Model
from steelyard.model.terms.axes import finds_of
from steelyard.runs.cutoffs_and_rest_speed import rounded
from steelyard.runs.run import Run

IN_DOUBT = 2.0  # cut-off over the band of errors from which on lower ones are tried
HALVINGS = 3  # lower cut-offs that are tried, each half of the one before
WORTH = 0.05  # fall of the error that a lower cut-off must bring, relative to it


@dataclass(frozen=True)
class CutoffChoice:
    """Cut-offs that were tried, the highest first, and their errors on left-out motion."""

    cutoffs: tuple[float, ...]  # [Hz]
    errors: tuple[float, ...]  # mean over parts of the typical and the pooled error [%]

    @property
    def chosen(self) -> float:
        """The highest cut-off whose error no lower one undercuts by as much as is worth it [Hz]."""
        least = min(self.errors)
        return next(
            cutoff
            for cutoff, error in zip(self.cutoffs, self.errors, strict=True)
            if error * (1.0 - WORTH) <= least
        )

    @property
    def note(self) -> str:
        """What was chosen and why, for people to read."""
        pairs = zip(self.cutoffs, self.errors, strict=True)
        listed = ", ".join(f"{cutoff:g} Hz {error:.3g} %" for cutoff, error in pairs)
        return (
            f"regression cut-off {self.chosen:g} Hz, chosen by the error on motion left out, below "
            f"{BAND:g} Hz: {listed}; matched_cutoff under [processing] states another one"
        )


def choose_cutoff(
    model: Model, runs: Sequence[Run], threads: int = 1, progress: Progress = silent
) -> CutoffChoice | None:
    """The cut-off at which a model's laws predict left-out motion best.

    `None` where the runs' own is not far above the band of errors, or nothing can be left out.
    """
    first = runs[0].matched_cutoff
    if first <= IN_DOUBT * BAND or any(finds_of(term) for term in model.terms):
        return None
    tried = tuple(rounded(first / 2**k) for k in range(HALVINGS + 1) if first / 2**k >= BAND)
    regressor, values = base_regressor(model), values_by(WeightedLeastSquares())
    try:
        divided, known = folding(runs), []
        for number, cutoff in enumerate(dict.fromkeys((*tried, BAND))):
            report_progress(progress, "choosing the cut-off", number, len(tried) + 1)
            information_of = information_from(
                [behind(run, cutoff) for run in runs],
                rests=has_memory(model.terms),
                longest=divided.longest,
                threads=threads,
            )
            known.append(information_of(regressor))
        folds = divided.parts(known[-1])
        parts = [per_fold(one, folds) for one in known]
        judge = parts[-1]
        sizes = np.array([judge.of([k]).effort_squares() for k in range(len(judge.windows))])
        errors = [
            float(np.exp(logarithms(left_out_errors(one, judge, values), sizes).mean()))
            for one in parts[: len(tried)]
        ]
    except (DataError, LogError):
        return None
    return CutoffChoice(tried, tuple(errors))


def behind(run: Run, cutoff: float) -> Run:
    """The run behind another parallel filter [Hz]."""
    processing = replace(run.chain.processing, matched_cutoff=cutoff)
    return replace(run, chain=replace(run.chain, processing=processing))

"""What 95 % intervals of parameters and bands of predicted efforts cover, wrong models included.

Ten draws, or as many as the argument says, of each disturbance of `coverage_cases`: three runs of
the demo arm are fitted as `identify` does it, one of another motion is predicted. Then the bands of
five real robots on motion that was not fitted. Where the model is wrong, intervals of parameters
hold, or the sentence that they do not cover what the model lacks stands beside the headline.
"""

import math
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from unittest.mock import patch

import numpy as np
from proofs.robots.consistent_real import cases
from proofs.robots.scores import identified
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.coverage_cases import ROWS, Case, Row, case_of, robot_file

from steelyard.base.arrays import Z95, Array
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.incomplete_model_and_unseen_error import model_error_check
from steelyard.check.signals.velocity_scale_and_lag import one_sided_differences
from steelyard.estimate.consistent.convex_program_and_newton_refinement import Program
from steelyard.estimate.identified_model import Provenance
from steelyard.estimate.scores.parts_and_bands_along_run import Bands
from steelyard.estimate.scores.score import score
from steelyard.identify.fit import Fit, calibrated, fit
from steelyard.identify.fit_preparation import FitTask
from steelyard.model.model import model_with_open_friction

DRAWS = 10

CHECKED = 8
"""Draws in which the fit is checked for what the model lacks."""

PROCESSES = 2

BAND = (93.0, 97.0)
"""Of all samples of all joints, mean over the draws of a row, or of one real log [%]."""

PARAMETERS = (93.0, 97.0)
"""Of all pairs of parameter and draw, where the model is right [%]."""

EDGE = 90.0
"""Of the parameters that the edge of consistent bodies concerns, a few in each draw [%]."""

SCATTER = 1.0
"""Scatter of a mean over 30 draws, and of one real log's, that the bounds do not count [%]."""

NAMED = 90.0
"""Share of the draws in which the sentence must be there where intervals do not hold [%]."""


def covered(row: Row, seed: int) -> tuple[float, float, float]:
    """What one draw gives [%].

    Returns:
        Share of the parameters in their intervals, share of the unseen samples in their bands, and
        100 if model or log are reported as wrong, else 0; NaN in all but the first draws.
    """
    case, found = fitted(row, seed)
    model = calibrated(found).identified
    inside = errors(case, found) <= Z95 * model.estimate.std
    bands = Bands.of(model)
    predicted = score(
        model.valued, case.unseen, model.signals.gains, model.cutoffs.score, bands=bands
    )
    share = predicted.coverage_percent
    named = float("nan")
    if seed < CHECKED:
        named = 100.0 * (
            differenced(case) or bool(model_error_check(FittedCase(model, found.fitted.runs)))
        )
    return 100.0 * float(inside.mean()), float("nan") if share is None else share, named


def differenced(case: Case) -> bool:
    """Whether logged velocities are differences of positions, which `check` says before a fit."""
    log, signals = case.fitted[0].recording.log, case.fitted[0].recording.signals
    if signals.velocity is None:
        return False
    columns = (signals.time, *signals.position, *signals.velocity)
    table = np.concatenate(list(log.parts(columns, (0, None), 100_000)))
    n = len(signals.position)
    return bool(one_sided_differences(table[:, 0], table[:, 1 : n + 1], table[:, n + 1 :]).all())


def fitted(row: Row, seed: int) -> tuple[Case, Fit]:
    """The runs of one draw, and their fit."""
    case, loaded = case_of(row, seed), robot_file()
    origin = Provenance("proof", {}, (), ())
    task = FitTask(model_with_open_friction(loaded), loaded, tuple(case.fitted))
    return case, fit(task, origin)


def errors(case: Case, found: Fit) -> Array:
    """Sizes of the errors of all base parameters, shape `(p,)`."""
    base, parameters = found.identified.base, found.identified.estimate.parameters
    values = case.truth.values.as_dict()
    true = base.base_values(np.array([values[name] for name in base.names]))
    named = dict(zip(base.base_names, true, strict=True))
    return np.abs(parameters.values - [named[name] for name in parameters.names])


def at_edges(row: Row, seed: int) -> tuple[list[bool], list[bool]]:
    """Whether intervals hold that the penalty's curvature at the edge would narrow by 10 %.

    Returns:
        As they are stated, and with that curvature.
    """
    case, found = fitted(row, seed)
    with patch.object(Program, "stated_precision", Program.precision):
        narrow = found.estimator(found.fitted.information).std
    stated, error = found.identified.estimate.std, errors(case, found)
    there = stated > 1.1 * narrow
    return (
        (error <= Z95 * stated)[there].tolist(),
        (error <= Z95 * narrow)[there].tolist(),
    )


def of_edges(row: Row, draws: int, pool: ProcessPoolExecutor) -> Claim:
    """The claim on parameters of bodies at the edge of what can exist."""
    found = list(pool.map(partial(at_edges, row), range(draws)))
    stated, narrow = (100.0 * float(np.mean(sum(some, []))) for some in zip(*found, strict=True))
    number = sum(len(some) for some, _ in found)
    figure = f"{stated:.1f} % of {number} ({narrow:.1f} % with the curvature at the edge)"
    name = f"intervals at the edge, {row.name}"
    return Claim(name, figure, f">= {EDGE:g} %", stated >= EDGE)


def scatter(draws: int) -> float:
    """Of a mean over so many draws [%]."""
    return SCATTER * math.sqrt(30.0 / draws)


def within(value: float, bounds: tuple[float, float], draws: int = 30) -> bool:
    """Whether a share is within bounds, but for the scatter of few draws."""
    return bounds[0] - scatter(draws) <= value <= bounds[1] + scatter(draws)


def spelt(bounds: tuple[float, float], draws: int) -> str:
    """Bounds for people to read."""
    return f"{bounds[0]:g} to {bounds[1]:g} %, ± {scatter(draws):.2g} for {draws} draws"


def of_row(row: Row, draws: int, pool: ProcessPoolExecutor) -> list[Claim]:
    """Claims of one disturbance."""
    found = np.array(list(pool.map(partial(covered, row), range(draws))))
    parameters, bands, named = np.nanmean(found, axis=0)
    least, most = found[:, 1].min(), found[:, 1].max()
    figure = f"{bands:.1f} % (single draws {least:.0f} to {most:.0f} %)"
    bound = spelt(PARAMETERS, draws)
    bound += "" if row.right else f", or the sentence in {NAMED:g} % of the draws"
    hold = within(parameters, PARAMETERS, draws) or (not row.right and named >= NAMED)
    return [
        Claim(f"bands, {row.name}", figure, spelt(BAND, draws), within(bands, BAND, draws)),
        Claim(
            f"intervals, {row.name}",
            f"{parameters:.1f} %, named as wrong in {named:.0f} % of {min(CHECKED, draws)} draws",
            bound,
            hold,
        ),
    ]


def real() -> list[Claim]:
    """Bands of the real robots on motion that was not fitted."""
    tiago = data_folder() / "tiago" / "tiago_run1_rows0_5600.parquet"
    logs = [(case.name, case.fitted, case.unseen) for case in cases()]
    logs.append(("tiago", [f"{tiago}#921:4443"], [f"{tiago}#4443:5600"]))
    claims = []
    for name, known, unseen in logs:
        share = identified(name, known, unseen)["validation"][0]["band_coverage_percent"]
        bound = f"{BAND[0]:g} to {BAND[1]:g} %, ± {SCATTER:g} for one log"
        claims.append(
            Claim(f"bands, {name}, motion not fitted", f"{share:.1f} %", bound, within(share, BAND))
        )
    return claims


def main(draws: int = DRAWS) -> list[Claim]:
    """The table of disturbances, then the real robots."""
    claims = []
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        for row in ROWS:
            claims += of_row(row, draws, pool)
            claims += [of_edges(row, draws, pool)] if row.thin < 1.0 else []
            print(claims[-1].name, claims[-1].value, file=sys.stderr, flush=True)
    return [*claims, *real()]


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:2])))

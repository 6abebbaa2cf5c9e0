"""What 95 % intervals of parameters and bands of predicted efforts cover, wrong models included.

Thirty draws of each disturbance of `coverage_cases`: three runs of the demo arm are fitted as
`identify` does it, one of another motion is predicted. Then the bands of five real robots on motion
that was not fitted. Where the model is wrong, its values are not those of the truth: intervals of
parameters are then counted, not judged.
"""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
from claims import Claim, data_folder, main_of
from coverage_cases import ROWS, Row, case_of, robot_file
from p02_scores import identified
from p25_consistent_real import cases

from steelyard.cli.fitting import Payload, calibrated, fit
from steelyard.cli.river import model_of
from steelyard.estimation.estimate import Z95
from steelyard.estimation.identified import Provenance
from steelyard.progress import silent
from steelyard.validation.bands import Bands
from steelyard.validation.score import score

DRAWS = 30
PROCESSES = 2

BAND = (93.0, 97.0)
"""Of all samples of all joints, mean over the draws of a row, or of one real log [%]."""

PARAMETERS = (93.0, 97.0)
"""Of all pairs of parameter and draw, where the model is right [%]."""

SCATTER = 1.0
"""Scatter of a mean over the draws, and of one real log's, that the bounds do not count [%]."""


def covered(row: Row, seed: int) -> tuple[float, float]:
    """Shares of the parameters in their intervals, and of the unseen samples in their bands."""
    case, loaded = case_of(row, seed), robot_file()
    origin = Provenance("proof", {}, (), ())
    found = fit(model_of(loaded), loaded, case.fitted, (), Payload(), origin, 1, silent)
    model = calibrated(found, 1, silent).identified
    estimate, base = model.estimate, model.base
    values = case.truth.values.as_dict()
    true = dict(
        zip(
            base.base_names,
            base.base_values(np.array([values[name] for name in base.names])),
            strict=True,
        )
    )
    wanted = np.array([true[name] for name in estimate.parameters.names])
    inside = np.abs(estimate.parameters.values - wanted) <= Z95 * estimate.std
    bands = Bands.of(model)
    predicted = score(
        model.valued, case.unseen, model.signals.gains, model.cutoffs.score, bands=bands
    )
    share = predicted.coverage_percent
    return 100.0 * float(inside.mean()), float("nan") if share is None else share


def within(value: float, bounds: tuple[float, float]) -> bool:
    """Whether a share is within bounds, but for the scatter of few draws."""
    return bounds[0] - SCATTER <= value <= bounds[1] + SCATTER


def spelt(bounds: tuple[float, float]) -> str:
    """Bounds for people to read."""
    return f"{bounds[0]:g} to {bounds[1]:g} %, ± {SCATTER:g} for {DRAWS} draws"


def of_row(row: Row, pool: ProcessPoolExecutor) -> list[Claim]:
    """Claims of one disturbance."""
    found = np.array(list(pool.map(partial(covered, row), range(DRAWS))))
    parameters, bands = found.mean(axis=0)
    least, most = found[:, 1].min(), found[:, 1].max()
    figure = f"{bands:.1f} % (single draws {least:.0f} to {most:.0f} %)"
    bound = spelt(PARAMETERS) if row.right else "told: the model is wrong"
    return [
        Claim(f"bands, {row.name}", figure, spelt(BAND), within(bands, BAND)),
        Claim(
            f"intervals, {row.name}",
            f"{parameters:.1f} %",
            bound,
            not row.right or within(parameters, PARAMETERS),
        ),
    ]


def real() -> list[Claim]:
    """Bands of the real robots on motion that was not fitted."""
    tiago = data_folder() / "tiago" / "tiago_run1_rows0_5600.parquet"
    logs = [(case.name, case.fitted, case.unseen) for case in cases()]
    logs.append(("tiago", [f"{tiago}#921:4443"], [f"{tiago}#4443:5600"]))
    claims = []
    for name, fitted, unseen in logs:
        share = identified(name, fitted, unseen)["validation"][0]["band_coverage_percent"]
        bound = f"{BAND[0]:g} to {BAND[1]:g} %, ± {SCATTER:g} for one log"
        claims.append(
            Claim(f"bands, {name}, motion not fitted", f"{share:.1f} %", bound, within(share, BAND))
        )
    return claims


def main() -> list[Claim]:
    """The table of disturbances, then the real robots."""
    claims = []
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        for row in ROWS:
            claims += of_row(row, pool)
    return [*claims, *real()]


if __name__ == "__main__":
    main_of(main)

r"""Block bootstrap: how an estimate scatters when windows of time are drawn again.

Windows of every run are drawn with replacement, as many as the run has, and the estimator runs on
what was drawn; samples are not read again. Residuals may be correlated within windows, and the
estimator may be any. Of few windows, draws scatter too little, by $\sqrt{(W-1)/W}$ for `W` of them;
deviations are scaled by the inverse [Davison1997].
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate, Estimator
from steelyard.parameters import Parameters
from steelyard.progress import Progress, report_progress, silent
from steelyard.regression.information import Information

LEAST = 0.5
"""Share of the draws that must have given an estimate."""


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Estimates of data drawn again.

    Attributes:
        parameters: The estimate of the data as they are.
        draws: One estimate per row, deviations scaled; NaN where the windows drawn do not show the
            parameter, shape `(draws, p)`.
        failed: Draws that gave no estimate; they are not among the rows.
        windows: Windows of all runs together.
    """

    parameters: Parameters
    draws: Array
    failed: int
    windows: int

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter, shape `(p,)`."""
        deviations = self.draws - self.parameters.values
        return np.asarray(np.sqrt(np.nanmean(np.square(deviations), axis=0)))

    def interval(self, level: float = 0.95) -> tuple[Array, Array]:
        """Percentiles that leave out half of the rest on each side, two of shape `(p,)`.

        Args:
            level: Between 0 and 1.
        """
        rest = 50.0 * (1.0 - level)
        lower, upper = np.nanpercentile(self.draws, [rest, 100.0 - rest], axis=0)
        return lower, upper

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, without the draws."""
        lower, upper = self.interval()
        return {
            "draws": len(self.draws),
            "failed": self.failed,
            "windows": self.windows,
            "parameters": [
                {"name": n, "unit": u, "value": v, "std": s, "lower95": a, "upper95": b}
                for n, u, v, s, a, b in zip(
                    self.parameters.names,
                    self.parameters.units,
                    self.parameters.values.tolist(),
                    self.std.tolist(),
                    lower.tolist(),
                    upper.tolist(),
                    strict=True,
                )
            ],
        }


def bootstrap(
    estimator: Estimator[Information],
    information: Information,
    *,
    draws: int = 200,
    seed: int = 0,
    progress: Progress = silent,
) -> Bootstrap:
    """Estimate again and again from windows drawn with replacement, run by run.

    Args:
        estimator: What estimates.
        information: The data; every window is a block.
        draws: How often.
        seed: Same seed, same draws.
        progress: Told about every draw.

    Raises:
        Stopped: `progress` requested a stop.
        DataError: The data give no estimate, have a single window per run, or too few draws gave
            an estimate.
    """
    runs = _windows_by_run(information)
    count, kept = len(information.windows), len(information.windows) - len(runs)
    where = f"runs {', '.join(runs)}"
    if not kept:
        raise DataError(
            "a bootstrap needs several windows of time, and each run has one",
            where=where,
            fix="log for longer, or raise matched_cutoff in [processing] of the robot file",
        )
    whole, rng = estimator(information).parameters, np.random.default_rng(seed)
    found = []
    for number in range(draws):
        drawn = [int(k) for mine in runs.values() for k in rng.choice(mine, len(mine))]
        values = _values(estimator, information.of(drawn), whole)
        found += [] if values is None else [values]
        report_progress(progress, "resampling windows", number + 1, draws)
    if len(found) < LEAST * draws:
        raise DataError(
            f"only {len(found)} of {draws} bootstrap draws gave an estimate",
            where=where,
            fix="log for longer: the estimate exists only with certain windows",
        )
    scaled = (np.array(found) - whole.values) * np.sqrt(count / kept)
    return Bootstrap(whole, frozen(whole.values + scaled), draws - len(found), count)


def _windows_by_run(information: Information) -> dict[str, list[int]]:
    runs: dict[str, list[int]] = {}
    for number, window in enumerate(information.windows):
        runs.setdefault(window.run, []).append(number)
    return runs


def _values(
    estimator: Estimator[Information], drawn: Information, wanted: Parameters
) -> Array | None:
    """The parameters wanted, NaN where they are not seen; `None` without an estimate."""
    try:
        estimate: Estimate = estimator(drawn)
    except DataError:
        return None
    known = estimate.parameters.as_dict()
    return np.array([known.get(name, np.nan) for name in wanted.names])

r"""How well each parameter is identified; scatter of estimates and sensitivity to cut-offs.

A parameter is *identified* if its standard deviation is small next to its value. One that is small
itself, such as a product of inertia of a symmetric link, can never be; it has a *small effect* if
no value of its 95 % interval causes much effort, in a motion that is the same for all parameters:
at random states $i$ of the robot, with speeds and accelerations of 1 rad/s and 1 rad/s² (m/s, m/s²;
root mean square), its contribution to joint $r$ is at most

$$(|\hat\phi_k| + 1.96\,s_k)\,\frac{\mathrm{rms}_i\,Y_{rk}}{\mathrm{rms}_i\,\hat\tau_r}$$

of the effort that the model predicts. The motion of the fitted runs does not decide it: a
parameter that they do not excite causes little effort in them, however large it is.

For a bootstrap, windows of every run are drawn with replacement, as many as the run has, and the
estimator runs on what was drawn; samples are not read again. Residuals may be correlated within
windows, and the estimator may be any. Of few windows, draws scatter too little, by
$\sqrt{(W-1)/W}$ for `W` of them; deviations are scaled by the inverse [Davison1997].

Of $N$ estimates $X_i$ with the mean $\bar X$ [Wang, eq. 13], the sample standard deviation is
$\sqrt{\sum_i (X_i - \bar X)^2 / (N - 1)}$; that of the population divides by $N$. (Eq. 14 of [Wang]
divides the root by $N$; the numbers of its table I are those of the population.)
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array, Parameters, finite_json, frozen, records
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import full_regressor
from steelyard.estimate.information.information import Information
from steelyard.model.model import Model

ParameterStatus = Literal[
    "identified",
    "small effect",
    "poorly identified",
    "from the prior",
    "at a bound",
    "known",
    "removed",
    "not identifiable",
]
"""`identified`: standard deviation of at most `WELL` of the value; `small effect`: at most `SMALL`
of every joint's effort, with any value of its interval; `poorly identified`: neither; `from the
prior`: less than `FROM_DATA` of it are from the data; `at a bound`: of its law or of the robot
file, so that it has no interval; `known`: given, not estimated; `removed`: zero in a reduced model;
`not identifiable`: without any effect in the logs, or inseparable from others."""

WELL = 20.0  # relative standard deviation [%] up to which a parameter is identified
SMALL = 5.0  # share of a joint's effort [%] up to which a contribution is small
FROM_DATA = 20.0  # share from data [%] below which a value comes from the prior

LEAST_EFFORT = 0.03
"""Least effort that contributions are related to, over that of the joint with the largest one of
the same unit: no drive is built for next to nothing."""

STATES, STATES_OF_LOOPS = 400, 60  # fewer of loops, which are followed from one to the next


def statuses(identified: IdentifiedModel) -> dict[str, ParameterStatus]:
    """The status of every base parameter, by its name."""
    estimate, shares = identified.estimate, effort_shares(identified)
    own, learned = estimate.parameters, estimate.learned
    learned = np.ones(len(own)) if learned is None else learned
    figures = np.column_stack([own.values, estimate.std, 100.0 * learned]).tolist()
    found = {
        name: _status(value, std, shares.get(name, np.inf), from_data)
        for name, (value, std, from_data) in zip(own.names, figures, strict=True)
    }
    found |= dict.fromkeys(estimate.at_bound, "at a bound")
    found |= dict.fromkeys(estimate.known, "known")
    found |= dict.fromkeys((blind.name for blind in estimate.blind), "not identifiable")
    found |= dict.fromkeys((removed.name for removed in estimate.removed), "removed")
    return found


def effort_shares(identified: IdentifiedModel) -> dict[str, float]:
    """Share of a joint's effort [%] that a unit of each base parameter causes, the largest one."""
    columns, base = _columns(identified.model), identified.base
    efforts = _root_mean_square(columns @ identified.valued.values.values)
    units = np.array(identified.robot.effort_units)
    largest = np.array([efforts[units == unit].max() for unit in units])
    references = np.maximum(efforts, LEAST_EFFORT * largest)
    sizes = _root_mean_square(columns)
    shares = np.divide(
        100.0 * sizes, references[:, None], out=np.zeros_like(sizes), where=sizes > 0.0
    ).max(axis=0)
    return dict(zip(base.base_names, shares[list(base.independent)].tolist(), strict=True))


def _status(value: float, std: float, share: float, from_data: float) -> ParameterStatus:
    if from_data < FROM_DATA:
        return "from the prior"
    if 100.0 * std <= WELL * abs(value) and value:
        return "identified"
    return "small effect" if (abs(value) + Z95 * std) * share <= SMALL else "poorly identified"


def _root_mean_square(values: Array) -> Array:
    """Over the samples, the second axis."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=1)))


@lru_cache(maxsize=4)
def _columns(model: Model) -> Array:
    """Efforts per unit of every standard parameter at random states, shape `(n, N, p)`."""
    states = STATES_OF_LOOPS if model.robot.passive else STATES
    columns = full_regressor(model, n_samples=states, slow=0.0)
    return frozen(columns.reshape(model.robot.n, states, -1))


LEAST_DRAWS_ESTIMATED = 0.5  # share of the draws that must have given an estimate


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Estimates of data drawn again."""

    parameters: Parameters
    draws: Array  # deviations scaled, `(draws, p)`; NaN where windows do not show a parameter
    failed: int  # draws that gave no estimate; they are not among the rows
    windows: int  # windows of all runs together

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter, shape `(p,)`."""
        deviations = self.draws - self.parameters.values
        return np.asarray(np.sqrt(np.nanmean(np.square(deviations), axis=0)))

    def interval(self, level: float = 0.95) -> tuple[Array, Array]:
        """Percentiles that leave out half of `1 - level` on each side, two of shape `(p,)`."""
        rest = 50.0 * (1.0 - level)
        lower, upper = np.nanpercentile(self.draws, [rest, 100.0 - rest], axis=0)
        return lower, upper

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, without the draws."""
        (lower, upper), own = self.interval(), self.parameters
        rows = records(
            name=own.names,
            unit=own.units,
            value=own.values,
            std=self.std,
            lower95=lower,
            upper95=upper,
        )
        known = {"draws": len(self.draws), "failed": self.failed, "windows": self.windows}
        return {**known, "parameters": rows}


def bootstrap(
    estimator: Estimator[Information],
    information: Information,
    *,
    draws: int = 200,
    seed: int = 0,
    progress: Progress = silent,
) -> Bootstrap:
    """Estimate again and again from windows drawn with replacement, run by run."""
    runs = information.windows_of_runs
    count, kept = len(information.windows), len(information.windows) - len(runs)
    where = f"runs {information.runs}"
    if not kept:
        wrong = "a bootstrap needs several windows of time, and each run has one"
        fix = "log for longer, or raise matched_cutoff in [processing] of the robot file"
        raise DataError(wrong, where=where, fix=fix)
    whole, rng = estimator(information).parameters, np.random.default_rng(seed)
    found = []
    for number in range(draws):
        drawn = [int(k) for mine in runs.values() for k in rng.choice(mine, len(mine))]
        with suppress(DataError):
            known = estimator(information.of(drawn)).parameters.as_dict()
            found.append([known.get(name, np.nan) for name in whole.names])
        report_progress(progress, "resampling windows", number + 1, draws)
    if len(found) < LEAST_DRAWS_ESTIMATED * draws:
        wrong = f"only {len(found)} of {draws} bootstrap draws gave an estimate"
        fix = "log for longer: the estimate exists only with certain windows"
        raise DataError(wrong, where=where, fix=fix)
    scaled = (np.array(found) - whole.values) * np.sqrt(count / kept)
    return Bootstrap(whole, frozen(whole.values + scaled), draws - len(found), count)


@dataclass(frozen=True, eq=False)
class RepeatedEstimates:
    """Several estimates of the same parameters."""

    labels: tuple[str, ...]
    names: tuple[str, ...]  # parameters that at least one of them identifies, `p` of them
    units: tuple[str, ...]
    values: Array  # NaN where an estimation does not identify a parameter, shape `(N, p)`
    stated: Array  # stated standard deviations, likewise
    population: bool = False  # whether standard deviations divide by `N`, not by `N - 1`

    @classmethod
    def of(
        cls, estimates: Mapping[str, Estimate], *, population: bool = False
    ) -> "RepeatedEstimates":
        """The scatter of two or more estimates by their labels, parameters as they appear."""
        if len(estimates) < 2:
            wrong = f"{len(estimates)} estimation has no scatter"
            fix = "give two or more"
            raise DataError(wrong, where="repeated estimations", fix=fix)
        every = [estimate.parameters for estimate in estimates.values()]
        units = {n: u for own in every for n, u in zip(own.names, own.units, strict=True)}
        stated = [
            dict(zip(estimate.parameters.names, estimate.std.tolist(), strict=True))
            for estimate in estimates.values()
        ]
        values, spread = (
            frozen([[row.get(name, np.nan) for name in units] for row in numbers])
            for numbers in ([own.as_dict() for own in every], stated)
        )
        return cls(
            tuple(estimates), tuple(units), tuple(units.values()), values, spread, population
        )

    @property
    def count(self) -> NDArray[np.intp]:
        """Number of estimations that identify each parameter, shape `(p,)`."""
        return np.asarray(np.isfinite(self.values).sum(axis=0))

    @property
    def mean(self) -> Array:
        """Mean of each parameter, shape `(p,)`."""
        return np.asarray(np.nanmean(self.values, axis=0))

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter, NaN of a single value, shape `(p,)`."""
        squares = np.nansum(np.square(self.values - self.mean), axis=0)
        divisor = self.count - (0 if self.population else 1)
        single = self.count < 2
        return np.where(single, np.nan, np.sqrt(squares / np.where(single, 1, divisor)))

    @property
    def relative_percent(self) -> Array:
        """Standard deviation over the size of the mean [%], NaN at zero, shape `(p,)`."""
        size = np.abs(self.mean)
        known = size > 0.0
        return np.where(known, 100.0 * self.std / np.where(known, size, 1.0), np.nan)

    @property
    def stated_std(self) -> Array:
        """Root mean square of the stated standard deviations, shape `(p,)`."""
        return np.asarray(np.sqrt(np.nanmean(np.square(self.stated), axis=0)))

    @property
    def deviation(self) -> str:
        """Which standard deviation it is, in words."""
        return "population (1/N)" if self.population else "sample (1/(N - 1))"

    def rows(self) -> list[dict[str, Any]]:
        """One row per parameter, `None` where there is no number; `values` by estimation."""
        rows = records(
            name=self.names,
            unit=self.units,
            count=self.count,
            mean=self.mean,
            std=self.std,
            relative_percent=self.relative_percent,
            stated_std=self.stated_std,
            values=self.values.T,
        )
        return [finite_json(row) for row in rows]

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "estimations": list(self.labels),
            "deviation": "population" if self.population else "sample",
            "parameters": self.rows(),
        }


FACTORS = (0.5, 0.71, 1.41, 2.0)  # what both cut-offs are multiplied with, one fit each


@dataclass(frozen=True, eq=False)
class Variation:
    """A fit with other cut-offs."""

    factor: float  # both cut-offs over those of the result
    motion: float
    matched: float
    values: Array | None  # its parameters, in the result's order, shape `(p,)`; `None` if it failed
    fitted: float | None = None  # error on the runs that were fitted, of the headline's kind [%]
    unseen: float | None = None  # the same on runs that were not; `None` without any
    failed: str = ""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Fits with other cut-offs beside the result, with the deviations of its parameters `(p,)`."""

    parameters: Parameters
    std: Array
    result: Variation
    variations: Sequence[Variation]

    @property
    def spread(self) -> Array:
        """How far any of the fits has each parameter from the result, in standard deviations."""
        return np.asarray(np.max([self.shift(v) for v in self.variations], axis=0, initial=0.0))

    @property
    def rows(self) -> tuple[Variation, ...]:
        """The result among its variations, by factor."""
        return tuple(sorted((self.result, *self.variations), key=lambda v: v.factor))

    def shift(self, variation: Variation) -> Array:
        """How far one fit has each parameter from the result, in standard deviations."""
        if variation.values is None:
            return np.zeros(len(self.std))
        known = np.where(self.std > 0.0, self.std, np.inf)
        return np.asarray(np.abs(variation.values - self.parameters.values) / known)

    def median_shift(self, variation: Variation) -> float | None:
        """Median of `shift` over the parameters; `None` of a fit that failed."""
        return None if variation.values is None else float(np.median(self.shift(variation)))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "fits": [
                {
                    "factor": v.factor,
                    "motion_cutoff": v.motion,
                    "matched_cutoff": v.matched,
                    "identification_percent": v.fitted,
                    "validation_percent": v.unseen,
                    "median_shift_in_std": self.median_shift(v),
                    "failed": v.failed or None,
                }
                for v in self.rows
            ],
            "parameters": records(name=self.parameters.names, largest_shift_in_std=self.spread),
        }

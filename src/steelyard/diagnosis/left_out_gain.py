"""Whether a cause of residuals also predicts motion that was left out of the fit.

A term with many parameters explains residuals of the motion it is fitted to, and may predict other
motion worse. Each part of the fitted runs is left out in turn, and predicted by weighted least
squares of all others, without and with the columns of the cause.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.causes import Cause
from steelyard.errors import DataError
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.fold_errors import logarithms
from steelyard.estimation.least_squares.normal_equations import solve
from steelyard.estimation.per_run import Runs, own_columns
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.regression.base import base_parameters
from steelyard.regression.information import Information
from steelyard.regression.regressor import Regressor
from steelyard.validation.cross import folding, left_out_errors, per_fold
from steelyard.validation.friction.friction import SURE_OF_ANY, worse

WORTH = 0.05
"""Least relative reduction of the error on left-out motion that is worth another term."""

WORTH_A_SEARCH = 0.2
"""The same of an error of the geometry or of an effort, which people have to look for on the robot:
its columns stand for other effects as well, and reduce the error of a sound Panda by up to 14 %."""


@dataclass(frozen=True)
class LeftOutGain:
    """Errors on left-out motion without and with a cause.

    Attributes:
        before: Relative error without it: the geometric mean of a typical joint's and of all
            joints' together, mean over parts [%].
        after: The same with it [%].
        confirmed: Whether it is reduced by more than is worth it, and than chance explains over
            parts.
        left_out: What is left out in turn, `run` or `segment`.
    """

    before: float
    after: float
    confirmed: bool
    left_out: str

    @classmethod
    def of(cls, plain: Array, errors: Array, left_out: str, worth: float) -> "LeftOutGain":
        """Of logarithms of the errors on each part without and with the cause."""
        before, after = float(np.exp(plain.mean())), float(np.exp(errors.mean()))
        confirmed = after < (1.0 - worth) * before and worse(plain, errors, SURE_OF_ANY)
        return cls(before, after, confirmed, left_out)

    @property
    def words(self) -> str:
        """Both errors."""
        return f"{self.before:.2g} %, with it {self.after:.2g} %"

    @property
    def change(self) -> str:
        """The difference relative to the error without it."""
        more = 100.0 * (self.after / self.before - 1.0)
        return f"{abs(more):.0f} % {'larger' if more >= 0.0 else 'smaller'} with it"


@dataclass(frozen=True, eq=False)
class Parts:
    """Fitted runs, where joints move, in parts that are left out in turn.

    Attributes:
        information: One window per part.
        left_out: What a part is, `run` or `segment`.
        weights: One per effort row, those of the fit.
        per_run: Columns whose parameters every run has for itself.
    """

    information: Information
    left_out: str
    weights: Array
    per_run: tuple[str, ...]

    @classmethod
    def of(cls, model: Model, regressor: Regressor, sigma: Array, runs: Sequence[Run]) -> "Parts":
        """Parts of runs.

        Args:
            model: The fitted model.
            regressor: Its columns, and more.
            sigma: Standard deviations of the fit's residuals, shape `(n,)`.
            runs: The fitted runs.

        Raises:
            DataError: They are too short.
        """
        divided = folding(runs)
        gathered = information_from(runs, longest=divided.longest)(regressor)
        weights = np.where(sigma > 0.0, 1.0 / np.square(np.where(sigma > 0.0, sigma, 1.0)), 0.0)
        found = per_fold(gathered, divided.parts(gathered))
        return cls(found, divided.left_out, weights, own_columns(model))

    def errors(self, names: Sequence[str]) -> Array:
        """Logarithm of the error on each part, by the columns of these names, shape `(parts,)`.

        Raises:
            DataError: The other parts are too few for a fit.
        """
        some = self.information.select(names)
        each = [some.of([k]).effort_squares() for k in range(len(some.windows))]
        return logarithms(left_out_errors(some, some, self._values), np.array(each))

    def _values(self, information: Information) -> Array:
        """Values of columns by least squares with the weights of the fit.

        Parameters of single runs have their mean over runs, as a new run is expected to have.
        """
        solution = solve(Runs.of(information, self.per_run), self.weights)
        values = solution.values.copy()
        each = [dict(zip(x.columns, x.values, strict=True)) for x in solution.locals]
        for column in {column for one in each for column in one}:
            values[column] = np.mean([one[column] for one in each if column in one])
        return values


def left_out_gains(
    model: Model, wide: Regressor, sigma: Array, runs: Sequence[Run], found: Sequence[Cause]
) -> tuple[LeftOutGain, ...]:
    """Per cause whether it predicts left-out motion better; none where the runs are too short.

    Args:
        model: The fitted model.
        wide: Columns of all causes, see `wide_model`.
        sigma: Standard deviations of the fit's residuals, shape `(n,)`.
        runs: The fitted runs.
        found: The causes.
    """
    own = base_parameters(model).base_names
    try:
        parts = Parts.of(model, wide, sigma, runs)
        plain, *wider = (parts.errors((*own, *more)) for more in ((), *(c.names for c in found)))
    except DataError:
        return ()
    worth = (WORTH if cause.of_friction else WORTH_A_SEARCH for cause in found)
    return tuple(
        LeftOutGain.of(plain, errors, parts.left_out, least)
        for errors, least in zip(wider, worth, strict=True)
    )

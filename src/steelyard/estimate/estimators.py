"""All estimators, under the names that commands and tables know them by."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from steelyard.base.errors import DataError, ModelError, advice
from steelyard.base.progress import Progress, silent
from steelyard.estimate.closed_loop.kalman import KalmanParameters
from steelyard.estimate.closed_loop.simulating_estimators import (
    ClosedLoopOutputError,
    Didim,
    InstrumentalVariables,
)
from steelyard.estimate.consistent.consistent import Consistent
from steelyard.estimate.consistent.log_cholesky import LogCholesky
from steelyard.estimate.consistent.penalties import Free, Pullback
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import Regressor
from steelyard.estimate.least_squares.constrained import (
    BoundedLeastSquares,
    WithKnownValues,
    base_bounds,
    fixed_values,
)
from steelyard.estimate.least_squares.least_squares import (
    OrdinaryLeastSquares,
    Recursive,
    WeightedLeastSquares,
)
from steelyard.estimate.least_squares.motion_noise import MotionNoise, TotalLeastSquares
from steelyard.estimate.least_squares.ridge import Ridge
from steelyard.estimate.least_squares.robust import Huber, Reweighted, Tukey, Weigh
from steelyard.estimate.prior.prior import Knowledge
from steelyard.estimate.reduction.reduction import Reduced

Needs = Literal["information", "samples", "experiment"]
"""What an estimator looks at; see `estimate.Estimator`."""


@dataclass(frozen=True, eq=False)
class Context:
    """What estimators are made from.

    Attributes:
        per_run: Columns whose parameters every run has for itself.
        equal: Whether the consistent estimates weigh all rows the same, as `identify` is to.
        progress: Told by estimators that search or simulate how far they are.
    """

    regressor: Regressor
    knowledge: Knowledge
    per_run: tuple[str, ...] = ()
    progress: Progress = silent
    equal: bool = False


@dataclass(frozen=True)
class Offer:
    """One estimator to choose.

    Attributes:
        needs: What it looks at.
        estimator: It, for a model and what is known of it.
        slow: Whether it searches or simulates, and so is compared only where it is named.
        uses: Tables and keys of the robot file that it uses.
        per_run: Whether it estimates parameters that every run has for itself.
    """

    name: str
    about: str
    needs: Needs
    estimator: Callable[[Context], Estimator[Any]]
    slow: bool = False
    uses: tuple[str, ...] = ()
    per_run: bool = True

    def make(self, context: Context) -> Estimator[Any]:
        """The estimator for a model and what is known of it.

        Raises:
            DataError: It would take parameters of single runs as shared.
        """
        if context.per_run and not self.per_run:
            raise DataError(
                "it does not estimate parameters per run",
                where=", ".join(context.per_run),
                fix="use another estimator, or leave per_run = true out of the robot file",
            )
        return self.estimator(context)


PRIOR, KNOWLEDGE = "[prior]", "[[knowledge]]"
"""Tables that say what is known beforehand."""

WEIGHTS = "[estimation] weights"
"""How joints weigh, for estimators that are to be had either way."""


def _with_known(estimator: Estimator[Information], context: Context) -> Estimator[Information]:
    """The estimator without the columns whose values prior constraints give."""
    fixed = fixed_values(context.regressor.base, context.knowledge).values
    return WithKnownValues(estimator, fixed) if fixed else estimator


def _consistent(context: Context, kind: type[Consistent] = Consistent) -> Consistent:
    base, own = context.regressor.base, context.per_run
    return kind(base, context.knowledge, per_run=own, equal=context.equal)


def _reweighted(context: Context, loss: Weigh) -> Reweighted:
    return Reweighted(loss, WeightedLeastSquares(per_run=context.per_run))


ESTIMATORS: tuple[Offer, ...] = (
    Offer(
        "OLS",
        "ordinary least squares",
        "information",
        lambda c: _with_known(OrdinaryLeastSquares(per_run=c.per_run), c),
    ),
    Offer(
        "WLS",
        "least squares, joints weighted by their noise",
        "information",
        lambda c: _with_known(WeightedLeastSquares(per_run=c.per_run), c),
    ),
    Offer(
        "consistent",
        "valid inertias, entropic distance to the prior",
        "information",
        _consistent,
        uses=(PRIOR, KNOWLEDGE, WEIGHTS),
    ),
    Offer(
        "pullback",
        "valid inertias, quadratic distance to the prior",
        "information",
        lambda c: replace(_consistent(c), form=Pullback()),
        uses=(PRIOR, KNOWLEDGE, WEIGHTS),
    ),
    Offer(
        "SDP",
        "valid inertias without prior: effect of the constraints alone",
        "information",
        lambda c: replace(_consistent(c), form=Free()),
        uses=(KNOWLEDGE, WEIGHTS),
    ),
    Offer(
        "TLS",
        "total least squares: noise in the regressor too",
        "information",
        lambda c: TotalLeastSquares(per_run=c.per_run),
    ),
    Offer(
        "ridge",
        "weighted least squares shrunk towards the nominal inertial parameters",
        "information",
        lambda c: Ridge.nominal(c.regressor.base, c.knowledge, c.per_run),
        uses=(PRIOR,),
    ),
    Offer(
        "reduced",
        "weighted least squares of the parameters that left-out data need",
        "information",
        lambda c: Reduced(),
        per_run=False,
    ),
    Offer(
        "RLS",
        "recursive least squares, forgetting 1 % per second",
        "information",
        lambda c: Recursive(forgetting=0.99),
        per_run=False,
    ),
    Offer(
        "Huber",
        "least squares with lower weights for large residuals",
        "samples",
        lambda c: _reweighted(c, Huber()),
    ),
    Offer(
        "Tukey",
        "least squares with zero weight for large residuals",
        "samples",
        lambda c: _reweighted(c, Tukey()),
    ),
    Offer(
        "ML",
        "maximum likelihood with noise of the measured motion",
        "samples",
        lambda c: MotionNoise(c.regressor, per_run=c.per_run),
    ),
    Offer(
        "bounded LS",
        "weighted least squares within bounds",
        "information",
        lambda c: BoundedLeastSquares(base_bounds(c.regressor.base, c.knowledge), c.per_run),
    ),
    Offer(
        "log-Cholesky",
        "the consistent estimate by Gauss-Newton in log-Cholesky coordinates",
        "information",
        lambda c: _consistent(c, LogCholesky),
        uses=(PRIOR, KNOWLEDGE, WEIGHTS),
    ),
    Offer(
        "IV",
        "instruments from the simulated closed loop",
        "experiment",
        lambda c: InstrumentalVariables(progress=c.progress),
        slow=True,
        per_run=False,
    ),
    Offer(
        "DIDIM",
        "simulated against measured torques",
        "experiment",
        lambda c: Didim(progress=c.progress),
        slow=True,
        per_run=False,
    ),
    Offer(
        "CLOE",
        "simulated against measured torques, with true sensitivities",
        "experiment",
        lambda c: ClosedLoopOutputError(progress=c.progress),
        slow=True,
        per_run=False,
    ),
    Offer(
        "EKF",
        "extended Kalman filter over the parameters",
        "experiment",
        lambda c: KalmanParameters(progress=c.progress),
        slow=True,
        per_run=False,
    ),
)


def estimators() -> tuple[tuple[str, str], ...]:
    """Names of all estimators, each with what it is in a few words.

    `identify` takes each of these names, in any case, as `method`; `compare` takes several.

    Example:
        >>> dict(estimators())["WLS"]
        'least squares, joints weighted by their noise'
    """
    return tuple((offer.name, offer.about) for offer in ESTIMATORS)


def offer_of(name: str, where: str, others: tuple[str, ...] = ()) -> Offer:
    """The estimator of a name, whatever its case and what stands between its words.

    Messages say where the name stands, and which `others` may stand there.

    Raises:
        ModelError: There is none.
    """
    known = {plain(offer.name): offer for offer in ESTIMATORS}
    if plain(name) not in known:
        names = (*(offer.name for offer in ESTIMATORS), *others)
        raise ModelError(
            f"there is no estimator '{name}'",
            where=where,
            fix=advice(name, names, "estimators", len(names)),
        )
    return known[plain(name)]


def plain(name: str) -> str:
    """A name whatever its case, and whatever stands between its words."""
    return name.lower().replace("-", " ").replace("_", " ")

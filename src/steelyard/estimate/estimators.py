"""All estimators, under the names that commands and tables know them by."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from steelyard.base.errors import DataError, ModelError, advice
from steelyard.base.progress import Progress, silent
from steelyard.estimate.consistent.consistent import Consistent
from steelyard.estimate.consistent.penalties import Free, Pullback
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import Regressor
from steelyard.estimate.least_squares.constrained import WithKnownValues, fixed_values
from steelyard.estimate.least_squares.least_squares import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.prior.prior import Knowledge

Needs = Literal["information", "samples", "experiment"]
"""What an estimator looks at; see `estimate.Estimator`."""


@dataclass(frozen=True, eq=False)
class Context:
    """What estimators are made from.

    Attributes:
        regressor: Model and columns.
        knowledge: What is known before the data.
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
        name: Short name, as tables show it.
        about: What it is, in a few words.
        needs: What it looks at.
        make: The estimator for a model and what is known of it.
        slow: Whether it searches or simulates, and so is compared only where it is named.
        uses: Tables and keys of the robot file that it uses.
    """

    name: str
    about: str
    needs: Needs
    make: Callable[[Context], Estimator[Any]]
    slow: bool = False
    uses: tuple[str, ...] = ()


PRIOR, KNOWLEDGE = "[prior]", "[[knowledge]]"
"""Tables that say what is known beforehand."""

WEIGHTS = "[estimation] weights"
"""How joints weigh, for estimators that are to be had either way."""


def _with_known(estimator: Estimator[Information], context: Context) -> Estimator[Information]:
    """The estimator without the columns whose values prior constraints give."""
    fixed = fixed_values(context.regressor.base, context.knowledge).values
    return WithKnownValues(estimator, fixed) if fixed else estimator


def _consistent(context: Context) -> Consistent:
    base, own = context.regressor.base, context.per_run
    return Consistent(base, context.knowledge, per_run=own, equal=context.equal)


def _refuse_own(context: Context) -> None:
    """Refuse parameters of single runs, for estimators that would take them as shared."""
    if context.per_run:
        raise DataError(
            "it does not estimate parameters per run",
            where=", ".join(context.per_run),
            fix="use another estimator, or leave per_run = true out of the robot file",
        )


def _bounded(context: Context) -> Estimator[Any]:
    from steelyard.estimate.least_squares.constrained import BoundedLeastSquares, base_bounds

    bounds = base_bounds(context.regressor.base, context.knowledge)
    return BoundedLeastSquares(bounds, per_run=context.per_run)


def _log_cholesky(context: Context) -> Estimator[Any]:
    from steelyard.estimate.consistent.log_cholesky import LogCholesky

    base, own = context.regressor.base, context.per_run
    return LogCholesky(base, context.knowledge, per_run=own, equal=context.equal)


def _huber(context: Context) -> Estimator[Any]:
    from steelyard.estimate.least_squares.robust import Huber, Reweighted

    return Reweighted(Huber(), WeightedLeastSquares(per_run=context.per_run))


def _tukey(context: Context) -> Estimator[Any]:
    from steelyard.estimate.least_squares.robust import Reweighted, Tukey

    return Reweighted(Tukey(), WeightedLeastSquares(per_run=context.per_run))


def _total(context: Context) -> Estimator[Any]:
    from steelyard.estimate.least_squares.motion_noise import TotalLeastSquares

    return TotalLeastSquares(per_run=context.per_run)


def _ridge(context: Context) -> Estimator[Any]:
    from steelyard.estimate.least_squares.ridge import Ridge

    return Ridge.nominal(context.regressor.base, context.knowledge, context.per_run)


def _reduced(context: Context) -> Estimator[Any]:
    from steelyard.estimate.reduction.reduction import Reduced

    _refuse_own(context)
    return Reduced()


def _recursive(context: Context) -> Estimator[Any]:
    from steelyard.estimate.least_squares.least_squares import Recursive

    _refuse_own(context)
    return Recursive(forgetting=0.99)


def _motion_noise(context: Context) -> Estimator[Any]:
    from steelyard.estimate.least_squares.motion_noise import MotionNoise

    return MotionNoise(context.regressor, per_run=context.per_run)


def _instrumental(context: Context) -> Estimator[Any]:
    from steelyard.estimate.closed_loop.simulating_estimators import InstrumentalVariables

    _refuse_own(context)
    return InstrumentalVariables(progress=context.progress)


def _didim(context: Context) -> Estimator[Any]:
    from steelyard.estimate.closed_loop.simulating_estimators import Didim

    _refuse_own(context)
    return Didim(progress=context.progress)


def _output_error(context: Context) -> Estimator[Any]:
    from steelyard.estimate.closed_loop.simulating_estimators import ClosedLoopOutputError

    _refuse_own(context)
    return ClosedLoopOutputError(progress=context.progress)


def _kalman(context: Context) -> Estimator[Any]:
    from steelyard.estimate.closed_loop.kalman import KalmanParameters

    _refuse_own(context)
    return KalmanParameters(progress=context.progress)


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
    Offer("TLS", "total least squares: noise in the regressor too", "information", _total),
    Offer(
        "ridge",
        "weighted least squares shrunk towards the nominal inertial parameters",
        "information",
        _ridge,
        uses=(PRIOR,),
    ),
    Offer(
        "reduced",
        "weighted least squares of the parameters that left-out data need",
        "information",
        _reduced,
    ),
    Offer("RLS", "recursive least squares, forgetting 1 % per second", "information", _recursive),
    Offer("Huber", "least squares with lower weights for large residuals", "samples", _huber),
    Offer("Tukey", "least squares with zero weight for large residuals", "samples", _tukey),
    Offer(
        "ML",
        "maximum likelihood with noise of the measured motion",
        "samples",
        _motion_noise,
    ),
    Offer("bounded LS", "weighted least squares within bounds", "information", _bounded),
    Offer(
        "log-Cholesky",
        "the consistent estimate by Gauss-Newton in log-Cholesky coordinates",
        "information",
        _log_cholesky,
        uses=(PRIOR, KNOWLEDGE, WEIGHTS),
    ),
    Offer(
        "IV", "instruments from the simulated closed loop", "experiment", _instrumental, slow=True
    ),
    Offer("DIDIM", "simulated against measured torques", "experiment", _didim, slow=True),
    Offer(
        "CLOE",
        "simulated against measured torques, with true sensitivities",
        "experiment",
        _output_error,
        slow=True,
    ),
    Offer("EKF", "extended Kalman filter over the parameters", "experiment", _kalman, slow=True),
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

    Args:
        name: The name.
        where: Where it stands, for messages.
        others: What else may stand there.

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

"""All estimators by the names of commands and tables, what they are given of runs, their use."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, ModelError, advice
from steelyard.base.progress import Progress, silent
from steelyard.estimate.closed_loop.extended_kalman_filter import KalmanParameters
from steelyard.estimate.closed_loop.simulated_experiment import Experiment
from steelyard.estimate.closed_loop.simulating_estimators import (
    ClosedLoopOutputError,
    Didim,
    InstrumentalVariables,
)
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import Free, Pullback
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.information.base_parameters_and_regressor import Layout, Regressor
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples, in_units_of_joints
from steelyard.estimate.least_squares.errors_in_variables import MotionNoise, TotalLeastSquares
from steelyard.estimate.least_squares.genetic_algorithm import Genetic
from steelyard.estimate.least_squares.known_bounded_and_ridge import (
    BoundedLeastSquares,
    Ridge,
    WithKnownValues,
    base_bounds,
    fixed_values,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    Huber,
    OrdinaryLeastSquares,
    Recursive,
    Reweighted,
    Tukey,
    Weigh,
    WeightedLeastSquares,
)
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.estimate.prior.prior_constraint_kinds import knowledge_of
from steelyard.estimate.reduction.stopping_rules_and_reduction import reduced
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.sections import GeneticSection
from steelyard.robot.robot import refuse_floating
from steelyard.runs.run import Run

Needs = Literal["information", "samples", "experiment"]  # see `estimate.Estimator`


@dataclass(frozen=True, eq=False)
class Sources:
    """What estimators look at, of runs: samples and experiments are gathered on first use."""

    regressor: Regressor
    runs: Sequence[Run]
    information: Information
    threads: int
    progress: Progress

    def data(self, needs: Needs, information: Information) -> Any:
        """What an estimator is given of the runs in the windows of an information."""
        if needs == "information":
            return information
        return self.samples(information) if needs == "samples" else self.experiment(information)

    def samples(self, information: Information) -> FilteredSamples:
        """The samples that were summed up in the windows of an information."""
        given, found = _by_run(information), []
        for run in self.runs:
            if run.name in given:
                # samples are in the middle of the filter, not at its start
                taps = ParallelFilter.design(run.matched_cutoff, run.rate).taps
                lag, half = ((len(taps) - 1) // 2) / run.rate, 0.5 / run.rate
                windows = [
                    replace(w, start=w.start + lag - half, stop=w.stop + lag + half)
                    for w in given[run.name]
                ]
                found.append(self._gathered[run.name].during(windows))
        return reduce(add, found)

    def experiment(self, information: Information) -> Experiment:
        """An experiment of the runs of an information; how they were controlled is not logged."""
        refuse_floating(self.regressor.model.robot, "an estimator that simulates the robot")
        given, whole = _by_run(information), _by_run(self.information)
        for name, mine in given.items():
            if mine != whole[name]:
                wrong = "it simulates whole runs, and a part of this one is left out"
                fix = "give several logs, or several cuts of this one: LOG@0:10 LOG@10:20"
                raise DataError(wrong, where=name, fix=fix)
        runs = [run for run in self.runs if run.name in given]
        return Experiment.of_runs(self.regressor, runs, information=information)

    @cached_property
    def _gathered(self) -> dict[str, FilteredSamples]:
        runs = self.runs
        found = in_units_of_joints(self.regressor, runs, self.threads, self.progress)
        return {run.name: samples for run, samples in zip(runs, found, strict=True)}


def _by_run(information: Information) -> dict[str, set[Window]]:
    runs, windows = information.windows_of_runs, information.windows
    return {run: {windows[k] for k in mine} for run, mine in runs.items()}


@dataclass(frozen=True, eq=False)
class Context:
    """What estimators are made from."""

    regressor: Regressor
    knowledge: Knowledge
    per_run: tuple[str, ...] = ()  # columns whose parameters every run has for itself
    progress: Progress = silent  # told by estimators that search or simulate how far they are
    equal: bool = False  # whether the consistent estimates weigh all rows the same
    genetic: GeneticSection = GeneticSection()


@dataclass(frozen=True)
class Offer:
    """One estimator to choose."""

    name: str
    about: str
    estimator: Callable[[Context], Estimator[Any]]  # it, for a model and what is known of it
    uses: tuple[str, ...] = ()  # tables and keys of the robot file that it uses
    needs: Needs = "information"
    slow: bool = False  # whether it searches or simulates: compared only where it is named
    per_run: bool = True  # whether it estimates parameters that every run has for itself

    def make(self, context: Context) -> Estimator[Any]:
        """The estimator for a model and what is known of it."""
        if context.per_run and not self.per_run:
            wrong = "it does not estimate parameters per run"
            fix = "use another estimator, or leave per_run = true out of the robot file"
            raise DataError(wrong, where=", ".join(context.per_run), fix=fix)
        return self.estimator(context)


PRIOR, KNOWLEDGE = "[prior]", "[[knowledge]]"  # tables that say what is known beforehand
WEIGHTS = "[estimation] weights"  # how joints weigh, for estimators that are to be had either way

Making = Callable[[Context], Estimator[Any]]


def _least_squares(kind: type[OrdinaryLeastSquares | WeightedLeastSquares]) -> Making:
    return lambda c: _without_known(kind(per_run=c.per_run), c)


def _without_known(estimator: Estimator[Information], context: Context) -> Estimator[Information]:
    """The estimator without the columns whose values prior constraints give."""
    fixed, _ = fixed_values(context.regressor.base, context.knowledge)
    return WithKnownValues(estimator, fixed) if fixed else estimator


def _genetic(context: Context) -> Estimator[Information]:
    given = context.knowledge, context.genetic, context.progress
    return _without_known(Genetic(context.regressor.base, *given), context)


def _consistent(context: Context, **more: Any) -> Consistent:
    base, own = context.regressor.base, context.per_run
    return Consistent(base, context.knowledge, per_run=own, equal=context.equal, **more)


def _reweighted(loss: Weigh) -> Making:
    return lambda c: Reweighted(loss, WeightedLeastSquares(per_run=c.per_run))


def _simulating(name: str, about: str, kind: Callable[..., Estimator[Any]]) -> Offer:
    def make(context: Context) -> Estimator[Any]:
        return kind(progress=context.progress)

    return Offer(name, about, make, needs="experiment", slow=True, per_run=False)


ALL_KNOWN = (PRIOR, KNOWLEDGE, WEIGHTS)

ESTIMATORS: tuple[Offer, ...] = (
    Offer("OLS", "ordinary least squares", _least_squares(OrdinaryLeastSquares)),
    Offer(
        "WLS", "least squares, joints weighted by their noise", _least_squares(WeightedLeastSquares)
    ),
    Offer("consistent", "valid inertias, entropic distance to the prior", _consistent, ALL_KNOWN),
    Offer(
        "pullback",
        "valid inertias, quadratic distance to the prior",
        lambda c: _consistent(c, form=Pullback()),
        ALL_KNOWN,
    ),
    Offer(
        "SDP",
        "valid inertias without prior: effect of the constraints alone",
        lambda c: _consistent(c, form=Free()),
        (KNOWLEDGE, WEIGHTS),
    ),
    Offer(
        "TLS",
        "total least squares: noise in the regressor too",
        lambda c: TotalLeastSquares(per_run=c.per_run),
    ),
    Offer(
        "ridge",
        "weighted least squares shrunk towards the nominal inertial parameters",
        lambda c: Ridge.nominal(c.regressor.base, c.knowledge, c.per_run),
        (PRIOR,),
    ),
    Offer(
        "reduced",
        "weighted least squares of the parameters that left-out data need",
        lambda c: reduced,
        per_run=False,
    ),
    Offer(
        "RLS",
        "recursive least squares, forgetting 1 % per second",
        lambda c: Recursive(forgetting=0.99),
        per_run=False,
    ),
    Offer(
        "Huber",
        "least squares with lower weights for large residuals",
        _reweighted(Huber()),
        needs="samples",
    ),
    Offer(
        "Tukey",
        "least squares with zero weight for large residuals",
        _reweighted(Tukey()),
        needs="samples",
    ),
    Offer(
        "ML",
        "maximum likelihood with noise of the measured motion",
        lambda c: MotionNoise(c.regressor, per_run=c.per_run),
        needs="samples",
    ),
    Offer(
        "bounded LS",
        "weighted least squares within bounds",
        lambda c: BoundedLeastSquares(base_bounds(c.regressor.base, c.knowledge), c.per_run),
    ),
    Offer(
        "genetic",
        "least squares by a genetic algorithm within bounds",
        _genetic,
        (PRIOR, KNOWLEDGE),
        slow=True,
        per_run=False,
    ),
    _simulating("IV", "instruments from the simulated closed loop", InstrumentalVariables),
    _simulating("DIDIM", "simulated against measured torques", Didim),
    _simulating(
        "CLOE", "simulated against measured torques, with true sensitivities", ClosedLoopOutputError
    ),
    _simulating("EKF", "extended Kalman filter over the parameters", KalmanParameters),
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
    """The estimator of a name, whatever its case and what stands between its words."""
    known = {plain(offer.name): offer for offer in ESTIMATORS}
    if plain(name) not in known:
        names = (*(offer.name for offer in ESTIMATORS), *others)
        fix = advice(name, names, "estimators", len(names))
        raise ModelError(f"there is no estimator '{name}'", where=where, fix=fix)
    return known[plain(name)]


def plain(name: str) -> str:
    """A name whatever its case, and whatever stands between its words."""
    return name.lower().replace("-", " ").replace("_", " ")


LEAST_SQUARES = {"noise": "WLS", "equal": "OLS"}  # `least_squares` by weights of joints


def method_of(loaded: LoadedRobot, option: str | None = None) -> Offer:
    """The estimator that a robot file, or an option instead of it, requests."""
    given = loaded.estimation
    where = loaded.where("estimation", "method") if option is None else "method (--method)"
    name = given.method if option is None else option
    if plain(name) == plain("least_squares"):
        name = LEAST_SQUARES[given.weights]
    return offer_of(name, where, ("least_squares",))


def context_of(
    loaded: LoadedRobot, regressor: Regressor, fastest: Array, progress: Progress
) -> Context:
    """What estimators are made from, for motion up to speeds of each joint, `(n,)`."""
    model = regressor.model
    knowledge = knowledge_of(model, loaded, fastest)
    equal = loaded.estimation.weights == "equal"
    own, genetic = per_run_columns(model, regressor.layout), loaded.estimation.genetic
    return Context(regressor, knowledge, own, progress, equal, genetic)


def per_run_columns(model: Model, layout: Layout) -> tuple[str, ...]:
    """Columns whose parameters every run of a model has for itself."""
    own = set(model.per_run_names)
    return tuple(name for name in layout.columns if name in own)


def on_information(offer: Offer, context: Context, sources: Sources) -> Estimator[Information]:
    """An estimator for parts of some runs, whatever of them it looks at."""

    def estimate(information: Information) -> Estimate:
        estimator, why = offer.make(context), "its values are not finite"
        try:
            found = estimator(sources.data(offer.needs, information))
            if np.isfinite(found.values.values).all():
                return found
        except np.linalg.LinAlgError as error:
            why = f"a matrix cannot be solved with ({error})"
        fix = "log a motion that excites the joints more, or take another estimator"
        raise DataError(f"{offer.name} gives no estimate: {why}", where=information.runs, fix=fix)

    return estimate

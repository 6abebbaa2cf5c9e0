"""The estimator that is requested by name, and the data that it looks at."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add
from typing import Any

import numpy as np

from steelyard.base.errors import DataError
from steelyard.base.progress import Progress
from steelyard.estimate.closed_loop.experiment import Experiment
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.estimators import Context, Needs, Offer, offer_of, plain
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.information.regressor import Layout, ParallelFilter, Regressor
from steelyard.estimate.information.samples import FilteredSamples, gather_samples
from steelyard.estimate.least_squares.per_run import own_columns
from steelyard.estimate.prior.constraint_kinds import knowledge_of
from steelyard.model.model import Model
from steelyard.robot.file.loaded_robot import LoadedRobot
from steelyard.runs.run import Run, fastest_of

LEAST_SQUARES = {"noise": "WLS", "equal": "OLS"}
"""Which estimator `least_squares` is, by the weights of the joints."""


def method_of(loaded: LoadedRobot, option: str | None = None) -> Offer:
    """The estimator that a robot file, or an option instead of it, requests."""
    given = loaded.estimation
    where = loaded.where("estimation", "method") if option is None else "method (--method)"
    name = given.method if option is None else option
    if plain(name) == plain("least_squares"):
        name = LEAST_SQUARES[given.weights]
    return offer_of(name, where, ("least_squares",))


def context_of(
    loaded: LoadedRobot, regressor: Regressor, runs: Sequence[Run], progress: Progress
) -> Context:
    """What estimators are made from, for runs of a robot.

    Raises:
        ModelError: Knowledge names what is not there.
        DataError: Knowledge contradicts itself.
    """
    model = regressor.model
    knowledge = knowledge_of(model, loaded, fastest_of(runs))
    equal = loaded.estimation.weights == "equal"
    return Context(regressor, knowledge, per_run_columns(model, regressor.layout), progress, equal)


def per_run_columns(model: Model, layout: Layout) -> tuple[str, ...]:
    """Columns whose parameters every run of a model has for itself."""
    own = set(own_columns(model))
    return tuple(name for name in layout.columns if name in own)


@dataclass(frozen=True, eq=False)
class Sources:
    """What estimators look at, of runs: samples and experiments are gathered on first use.

    `information` is what all of the runs say about the regressor's columns.
    """

    regressor: Regressor
    runs: Sequence[Run]
    information: Information
    threads: int
    progress: Progress

    def data(self, needs: Needs, information: Information) -> Any:
        """What an estimator is given of the runs in the windows of an information.

        Raises:
            DataError: It needs whole runs, and there are parts of them.
        """
        if needs == "information":
            return information
        return self.samples(information) if needs == "samples" else self.experiment(information)

    def samples(self, information: Information) -> FilteredSamples:
        """The samples that were summed up in the windows of an information."""
        given = _by_run(information)
        runs = [run for run in self.runs if run.name in given]
        return reduce(
            add,
            [self._gathered[run.name].during(_at_samples(given[run.name], run)) for run in runs],
        )

    def experiment(self, information: Information) -> Experiment:
        """An experiment of the runs of an information; how they were controlled is not logged.

        Raises:
            DataError: A part of a run is missing, or the runs cannot be simulated.
        """
        given, whole = _by_run(information), _by_run(self.information)
        for name, mine in given.items():
            if mine != whole[name]:
                raise DataError(
                    "it simulates whole runs, and a part of this one is left out",
                    where=name,
                    fix="give several logs, or several cuts of this one: LOG@0:10 LOG@10:20",
                )
        runs = [run for run in self.runs if run.name in given]
        return Experiment.of_runs(self.regressor, runs, information=information)

    @cached_property
    def _gathered(self) -> dict[str, FilteredSamples]:
        model = self.regressor.model
        return {
            run.name: gather_samples(
                self.regressor,
                run,
                rests=has_memory(model.terms),
                threads=self.threads,
                progress=self.progress,
            ).scaled(run.recording.signals.gains, model.robot.effort_units)
            for run in self.runs
        }


def _at_samples(windows: Iterable[Window], run: Run) -> list[Window]:
    """The windows where their samples are: in the middle of the filter, not at its start."""
    taps = ParallelFilter.design(run.matched_cutoff, run.rate).taps
    lag, half = ((len(taps) - 1) // 2) / run.rate, 0.5 / run.rate
    return [replace(w, start=w.start + lag - half, stop=w.stop + lag + half) for w in windows]


def _by_run(information: Information) -> dict[str, set[Window]]:
    """The windows of every run."""
    runs, windows = information.windows_of_runs, information.windows
    return {run: {windows[k] for k in mine} for run, mine in runs.items()}


def on_information(offer: Offer, context: Context, sources: Sources) -> Estimator[Information]:
    """An estimator for parts of some runs, whatever of them it looks at.

    Raises:
        DataError: By its calls: the data cannot give an estimate, or not such data.
    """

    def estimate(information: Information) -> Estimate:
        estimator = offer.make(context)
        try:
            found = estimator(sources.data(offer.needs, information))
        except np.linalg.LinAlgError as error:
            raise _failed(offer, information, f"a matrix cannot be solved with ({error})") from None
        if not np.isfinite(found.values.values).all():
            raise _failed(offer, information, "its values are not finite")
        return found

    return estimate


def _failed(offer: Offer, information: Information, why: str) -> DataError:
    return DataError(
        f"{offer.name} gives no estimate: {why}",
        where=information.runs,
        fix="log a motion that excites the joints more, or take another estimator",
    )

"""What estimators are given of runs: information, samples or a simulated experiment."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add
from typing import Any, Literal

from steelyard.base.errors import DataError
from steelyard.base.progress import Progress
from steelyard.estimate.closed_loop.simulated_experiment import Experiment
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples, in_units_of_joints
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
        runs = self.runs
        found = in_units_of_joints(self.regressor, runs, self.threads, self.progress)
        return {run.name: samples for run, samples in zip(runs, found, strict=True)}


def _by_run(information: Information) -> dict[str, set[Window]]:
    """The windows of every run."""
    runs, windows = information.windows_of_runs, information.windows
    return {run: {windows[k] for k in mine} for run, mine in runs.items()}

r"""Stretches of production logs that say most about a model's parameters: `steelyard log select`.

Production repeats itself: of hours of pick and place a few minutes hold what all of them say. Logs
are cut into short windows; those that the model does not explain, as while something is carried or
touched, are left out. Of the others the best are chosen one by one, so that

$$ \log\det(P + \sum_w M_w) - \log\det P $$

grows most (greedy D-optimal design), with the sums of products $M_w$ weighted by the model's noise
and columns of unit length over all windows. $P = 10^{-4}$ keeps what no window shows from deciding.
Windows gain less the more are chosen, so that each is looked at again only where its last gain is
the largest (lazy greedy search).
"""

import heapq
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import in_order, start_pass
from steelyard.estimate.information.information import Information
from steelyard.identify.runs_and_notes_of_logs import runs_for
from steelyard.report.words import count
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import log_files, paths_of, refuse_overlaps

RIDGE = 1e-4  # information before any window, over that of all windows
UNEXPLAINED = 9.0  # squared residual of a window, in variances of the model's own logs
KEPT = 2048  # windows with the largest gains of their own that are compared


@dataclass(frozen=True)
class Stretch:
    """A stretch of a log [s]."""

    log: str
    start: float
    stop: float

    @property
    def text(self) -> str:
        """As other commands take it: LOG@START:STOP."""
        return f"{self.log}@{self.start:.6g}:{self.stop:.6g}"


@dataclass(frozen=True, eq=False)
class InformativeStretches:
    """Stretches in the order of their logs, and what they hold of all windows.

    Attributes:
        stretches: The chosen ones; neighbours are one.
        seconds: Their length in all [s].
        windows: Number of windows in all.
        chosen: Number of those that were chosen.
        unexplained: Number of those that the model does not explain.
        share: Share of the logarithm's rise by all explained windows, 0 to 1.
        information: What the chosen windows say, efforts in units of joints: an estimator's data.
        all_information: What all explained windows say, as one.
    """

    stretches: tuple[Stretch, ...]
    seconds: float
    windows: int
    chosen: int
    unexplained: int
    share: float
    information: Information
    all_information: Information

    @property
    def words(self) -> str:
        """What they hold, in one line."""
        text = f"{self.chosen} of {count(self.windows, 'window')} ({self.seconds:.0f} s) hold "
        text += f"{100.0 * self.share:.1f} % of log det"
        if self.unexplained:
            text += (
                f"; {count(self.unexplained, 'window')} left out, as the model does not explain "
            )
            text += "them (payload, contact, another state)"
        return text

    def __str__(self) -> str:
        """One stretch a line, then what they hold."""
        return "\n".join([*(stretch.text for stretch in self.stretches), self.words])

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        found = {name: x for name, x in vars(self).items() if not name.endswith("information")}
        return {**found, "stretches": [stretch.text for stretch in self.stretches]}


@dataclass(eq=False)
class _Windows:
    """Windows with the largest gains of their own, and the sums of all explained ones."""

    weights: Array  # of rows
    values: Array  # parameters of the model
    total: Information | None = None
    kept: list[tuple[float, int, Information, Stretch]] = field(default_factory=list)
    count: int = 0
    unexplained: int = 0

    def take(self, stretch: Stretch, information: Information) -> None:
        """Take in a window, unless the model does not explain it."""
        self.count += 1
        squares = float(self.weights @ information.residual_squares(self.values))
        if squares > UNEXPLAINED * float(information.n_samples.sum()):
            self.unexplained += 1
            return
        both = information if self.total is None else self.total + information
        self.total = both.grouped([range(len(both.windows))])
        matrix, whole = (x.normal(self.weights)[0] for x in (information, self.total))
        # a window's own gain beside the mean of all before it: for no more than a shortlist
        size = np.sqrt(np.maximum(np.diag(whole) / self.count, 1e-300))
        own = float(np.linalg.slogdet(np.eye(len(size)) + matrix / size[:, None] / size)[1])
        entry = (own, self.count, information, stretch)
        (heapq.heappush if len(self.kept) < KEPT else heapq.heappushpop)(self.kept, entry)


@checked(window=0.1, share=1.0)
def informative_stretches(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    *,
    share: float = 95.0,
    window: float = 2.0,
    progress: Progress = silent,
) -> InformativeStretches:
    """Choose the stretches of production logs that say most about a model's parameters.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        logs: Logs of normal operation.
        share: Share of what all windows say that the chosen ones hold, in percent of log det.
        window: Length of a window [s].
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or the model explains no window.

    Example:
        >>> found = informative_stretches("arm-model", "other.csv", share=90.0)
        >>> found.chosen < found.windows
        True
    """
    identified = load_model(model)
    files = log_files(paths_of(logs, least=1))
    refuse_overlaps(files, [])
    known, sigma = identified.estimate.parameters.as_dict(), identified.estimate.sigma
    columns = base_regressor(identified.model).layout.columns
    values = np.array([known.get(name, 0.0) for name in columns])
    windows = _Windows(1.0 / np.maximum(np.square(sigma), 1e-300), values)
    for file in files:
        (run,) = runs_for(identified, [file], progress, at_rest=False)
        for one in _windows_of(identified, run, file.text, window, progress):
            windows.take(*one)
    if windows.total is None:
        raise LogError(
            f"the model explains none of {count(windows.count, 'window')}",
            where=", ".join(file.text for file in files),
            fix="`steelyard check --model` names what differs; or identify the model anew",
        )
    report_progress(progress, "choosing stretches", 0, 1)
    numbers, reached = _chosen(windows, windows.total, share / 100.0)
    chosen = [windows.kept[k][3] for k in numbers]
    return InformativeStretches(
        _joined(chosen),
        sum(stretch.stop - stretch.start for stretch in chosen),
        windows.count,
        len(chosen),
        windows.unexplained,
        reached,
        reduce(add, (windows.kept[k][2] for k in numbers)),
        windows.total,
    )


def _windows_of(
    identified: IdentifiedModel, run: Run, log: str, window: float, progress: Progress
) -> Iterator[tuple[Stretch, Information]]:
    """The windows of a run, each with its information in units of joints."""
    regressor = base_regressor(identified.model)
    rests = identified.model.has_memory
    accumulator, pieces, signature = start_pass(regressor, run, rests, window)
    layout, gains = regressor.layout, identified.signals.gains
    units, name = identified.model.robot.effort_units, log.rpartition("@")[0] or log
    for (own, _), sums in in_order(accumulator, pieces, os.cpu_count() or 1):
        report_progress(progress, f"looking at {run.name}", own.stop, run.span[1])
        if sums.counts.any():
            found = Information(
                layout, signature, (own,), sums.grams[None], sums.absolute[None], sums.counts[None]
            )
            found = found.with_effective_samples(accumulator.matched.inflation)
            yield Stretch(name, own.start, own.stop), found.scaled(gains, units)


def _chosen(windows: _Windows, total: Information, share: float) -> tuple[list[int], float]:
    """Windows that together reach a share, or all that are compared; and the share they reach."""
    every = total.normal(windows.weights)[0]
    size = np.sqrt(np.diag(every))
    scale = np.where(size > 0.0, size, np.inf)
    ridge = RIDGE * np.eye(len(scale))

    def rise(matrix: Array) -> float:
        return float(np.linalg.slogdet(ridge + matrix)[1]) - len(scale) * float(np.log(RIDGE))

    whole = rise(every / scale[:, None] / scale)
    each = (information.normal(windows.weights)[0] for _, _, information, _ in windows.kept)
    matrices = [matrix / scale[:, None] / scale for matrix in each]
    reached, have = 0.0, np.zeros_like(ridge)
    heap = [(-rise(matrix), k, 0) for k, matrix in enumerate(matrices)]
    heapq.heapify(heap)
    chosen: list[int] = []
    while heap and reached < share * whole:
        gain, k, seen = heapq.heappop(heap)
        if seen < len(chosen):  # others were chosen since: it may gain less now
            heapq.heappush(heap, (reached - rise(have + matrices[k]), k, len(chosen)))
            continue
        chosen.append(k)
        have = have + matrices[k]
        reached -= gain
    return chosen, reached / whole if whole else 0.0


def _joined(chosen: list[Stretch]) -> tuple[Stretch, ...]:
    """In the order of logs and time; neighbours as one."""
    found: list[Stretch] = []
    for one in sorted(chosen, key=lambda s: (s.log, s.start)):
        last = found[-1] if found else None
        if last is not None and last.log == one.log and one.start <= last.stop + 0.05:
            found[-1] = Stretch(last.log, last.start, max(last.stop, one.stop))
        else:
            found.append(one)
    return tuple(found)

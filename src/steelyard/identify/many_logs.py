"""Parameters from all of many logs, whose sums workers make: what `identify --cluster` adds.

A few of the logs, spread over all, are identified as always: they decide cut-offs, friction laws,
gains and what is checked. Workers then make the sums of products of every log; these are added, and
the same estimator gives the parameters.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress
from steelyard.check.finding import Finding, Severity
from steelyard.estimate.changes_from_model import LocalParameters
from steelyard.estimate.estimator_register import method_of
from steelyard.estimate.information.gather import MOST_WINDOWS
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.part_information import PartSummary
from steelyard.estimate.logs_left_out import LeftOut
from steelyard.identify.fit import Fit
from steelyard.identify.remembered_parts import (
    TRIED,
    DigestedParts,
    RememberedParts,
    with_reading_of,
)
from steelyard.identify.repeated_motion_and_validation_split import repeat_of
from steelyard.logs.log_parts import LogPart, middle_of, pieces_of, whole_logs
from steelyard.logs.remembered_work import RememberedWork, remembered_work
from steelyard.report.words import count
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.robot import refuse_floating
from steelyard.runs.run import MotionSamples, Run
from steelyard.runs.runs_of_named_logs import LogArgument, names_of_parts, sha256

WINDOWS_OF_PART = 4  # windows that the sums of a part keep, for the correlation of residuals
MOST_MOTIONS = 500  # parts of which a model keeps samples
MOST_NAMED = 3  # logs that a note names
MANY_LEFT_OUT = 0.1  # share of the logs, but those at rest, from which on the result is doubtful


@dataclass(frozen=True, eq=False)
class ManyLogs:
    """Parts of the logs, and the store that remembers work on them."""

    of: DigestedParts
    memory: RememberedWork
    copies: tuple[str, ...] = ()  # logs with the bytes of another one, and of which


def refuse_beside_workers(loaded: LoadedRobot, **asked: object) -> None:
    """A `DataError` where what is asked needs all runs in one process."""
    refuse_floating(loaded.robot, "the work of workers")
    method = method_of(loaded)
    if method.needs != "information":
        raise DataError(
            f"{method.name} needs whole runs, and workers give sums of products",
            where="method (--method), with a cluster",
            fix="choose WLS, OLS or the consistent estimator",
        )
    idle = [name for name, value in asked.items() if value]
    if idle:
        raise DataError(
            f"whole runs are needed for {' and '.join(idle)}, and workers give sums of products",
            where="cluster (--cluster)",
            fix=f"leave out {' and '.join(f'--{name}' for name in idle)}, or the cluster",
        )


@contextmanager
def many_logs(
    logs: Sequence[str], unseen: Sequence[LogArgument], progress: Progress
) -> Iterator[ManyLogs]:
    """The parts of all logs; a `DataError` where one is also among those that are `unseen`."""
    every = [piece for log in whole_logs(logs) for piece in pieces_of(log)]
    with remembered_work(None) as memory:
        of, copies = DigestedParts.of(every, memory, progress).without_copies()
        hashes = dict(zip(of.digests, of.parts, strict=True))
        for log in unseen:
            if (twice := hashes.get(sha256(log.path))) is not None:
                raise DataError(
                    "this log is both fitted and validated",
                    where=f"{log.text} and {twice.where}",
                    fix="validate with logs that are not among those that are fitted",
                )
        yield ManyLogs(of, memory, copies)


def spread_over(logs: ManyLogs) -> list[LogPart]:
    """Parts that a first model may be identified from, each the farthest from those before."""
    readable = logs.of.readable
    wanted, places = min(TRIED, len(readable)), list[int]()
    # 1/2, 1/4, 3/4, 1/8, 5/8, ... of the way: the radical inverse of 1, 2, 3, ...
    for number in range(1, 4 * len(readable) + 1):
        place = int(len(readable) * int(f"{number:b}"[::-1], 2) / 2.0 ** len(f"{number:b}"))
        if place not in places:
            places.append(place)
        if len(places) == wanted:
            break
    return [middle_of(logs.of.parts[readable[place]]) for place in places]


def of_all_logs(
    logs: ManyLogs,
    found: Fit,
    sample: Sequence[str],
    unseen: Sequence[Run],
    cluster: str,
    progress: Progress,
) -> tuple[Fit, tuple[str, ...], tuple[Finding, ...]]:
    """The fit with the parameters of all logs; notes, and doubts about logs that do not count.

    A `LogError` where none counts, a `DataError` where an `unseen` run has rows of one of them.
    """
    own = with_reading_of(found.identified, sample[0])
    parts = RememberedParts.with_model(logs.of, own, logs.memory, windows=WINDOWS_OF_PART)
    parts.make(parts.missing(), cluster, 1, progress)
    local = LocalParameters(own, parts.regressor.layout)
    summaries, _, out, used = parts.counted(local, progress)
    names = names_of_parts(parts.parts)
    motions = _motions(used, names, summaries)
    for run in unseen:
        repeat = repeat_of(motions, run)
        if repeat is not None and repeat.same:
            raise DataError(
                f"this log is both fitted and validated: it {repeat.words}",
                where=run.name,
                fix="validate with logs that are not among those that are fitted",
            )
    total = added_up(parts, used, names)
    estimate = found.fitted.estimating(found.fitted.runs, total)(total)
    samples = sum(summaries[number].samples for number in used)
    notes = (
        f"parameters of {_logs(parts, used)} ({samples} samples), whose sums workers made; "
        "cut-offs, laws, gains, zeros, checks, bands and "
        f"errors of fitted logs are those of {count(len(sample), 'log')}: "
        + ", ".join(run.name for run in found.fitted.runs),
        _errors(parts, used, names, estimate.parameters.values),
        *(f"left out: {one.log}: {one.wrong}" for one in out.values()),
        *(f"left out: {copy}" for copy in logs.copies),
    )
    origin, runs = found.identified.provenance, tuple(names[number] for number in used)
    inputs = {k: x for k, x in origin.inputs.items() if not k.startswith("identification ")}
    inputs |= {
        f"identification {names[number]}{Path(parts.parts[number].file.name).suffix}": digest
        for number, digest in enumerate(logs.of.digests)
        if number not in out
    }
    identified = replace(
        found.identified,
        estimate=estimate,
        reference=(found.beside(total),),
        motions=motions,
        provenance=replace(origin, inputs=inputs, runs=runs, notes=(*origin.notes, *notes)),
    )
    fitted = found.fitted._replace(estimate=estimate)
    whole = replace(found, identified=identified, fitted=fitted, unscaled=None)
    said = f"checks and errors of fitted runs are those of {len(sample)} of {_logs(parts, used)}"
    of_sample = Finding.ok(said, headline=True).by("many logs")
    return whole, _first(notes), (of_sample, *_doubts(out, len(parts.parts)))


def _motions(
    used: Sequence[int], names: Sequence[str], summaries: Sequence[PartSummary]
) -> tuple[MotionSamples, ...]:
    """Samples of parts, by which the model knows what it was fitted to; of very many, of some."""
    some = used[:: -(-len(used) // MOST_MOTIONS)]
    each = ((names[number], summaries[number].motion) for number in some)
    return tuple(
        MotionSamples.from_dict({**motion, "run": name}) for name, motion in each if motion
    )


def added_up(parts: RememberedParts, used: Sequence[int], names: Sequence[str]) -> Information:
    """The sums of some parts, in their order, in `MOST_WINDOWS` windows at most.

    Efforts are in the units of the joints.
    """
    size, groups = -(-len(used) // MOST_WINDOWS), list[Information]()
    apart = len(used) * WINDOWS_OF_PART <= MOST_WINDOWS
    for first in range(0, len(used), size):
        whole = reduce(add, _sums(parts, used[first : first + size], names))
        groups.append(whole if apart else whole.grouped([range(len(whole.windows))]))
    return reduce(add, groups)


def _sums(
    parts: RememberedParts, used: Sequence[int], names: Sequence[str]
) -> Iterator[Information]:
    """Sums of the parts that are used, which have some, under their names."""
    gains, units = parts.reference.signals.gains, parts.reference.model.robot.effort_units
    for number in used:
        one = parts.read(number)[1]
        assert one is not None
        windows = tuple(replace(window, run=names[number]) for window in one.windows)
        yield replace(one, windows=windows).scaled(gains, units)


def _logs(parts: RememberedParts, used: Sequence[int]) -> str:
    files = count(len({parts.parts[number].file.url for number in used}), "log")
    cut = any(parts.parts[number].rows is not None for number in used)
    return f"{count(len(used), 'part')} of {files}" if cut else files


def _errors(
    parts: RememberedParts, used: Sequence[int], names: Sequence[str], values: Array
) -> str:
    """How far efforts are from the model in all logs, also those that no score is of."""
    errors = list[float]()
    for one in _sums(parts, used, names):
        squares = one.residual_squares(values).sum() / max(one.effort_squares().sum(), 1e-300)
        errors.append(100.0 * float(np.sqrt(squares)))
    worst = sorted(range(len(used)), key=lambda k: -errors[k])[:MOST_NAMED]
    named = ", ".join(f"{names[used[k]]} {errors[k]:.3g} %" for k in worst)
    return (
        f"rms residual over rms effort, behind the regression's low-pass, all joints together: "
        f"median of all parts {np.median(errors):.3g} %, the largest {named}"
    )


def _first(notes: Sequence[str]) -> tuple[str, ...]:
    """The notes for people: of what is left out the first ones."""
    said, out = notes[:2], notes[2:]
    more = len(out) - MOST_NAMED
    rest = (f"and {count(more, 'more part')} left out, see model.json",) if more > 0 else ()
    return (*said, *out[:MOST_NAMED], *rest)


def _doubts(out: dict[int, LeftOut], parts: int) -> tuple[Finding, ...]:
    """That many logs do not count, those at rest aside."""
    wrong = [one for one in out.values() if not one.at_rest]
    others = parts - (len(out) - len(wrong))
    if len(wrong) <= MANY_LEFT_OUT * others:
        return ()
    says = f"{len(wrong)} of {count(others, 'part')} of the logs are left out, as "
    first = wrong[0]
    says += f"{first.log}: {first.wrong}"
    return (Finding("logs left out", "", Severity.DOUBTFUL, says, ""),)

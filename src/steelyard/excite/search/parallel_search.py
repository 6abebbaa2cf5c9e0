"""Searches in parallel processes, and the time kept for what comes after them.

The certificate, the report and the files take processor time that is known before the search; how
long that is by the clock depends on what else the machine does.

Run as a module, this file is such a process. It reads one pickle, the task, and writes one line of
JSON per search, `{"number", "x", "whole"}`; when its time is spent it writes what it has reached,
and ends. On the way it writes lines `{"reached"}`, the coefficients of a search so far. What goes
wrong is a line too. It ends when its standard input is closed: nobody reads it any more.
"""

import json
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, SteelyardError
from steelyard.base.progress import Progress, Stopped, module_command, report_progress, silent
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.design_problem_from_tables import Tables, build
from steelyard.excite.search.feasibility import NoMotion
from steelyard.excite.search.margins_barrier_and_newton import Deadline
from steelyard.excite.search.search_methods import method_of, seeded

KEPT_MOTIONS = 4  # best motions that are kept for the end

LOOKING_SECONDS = 0.1  # between two looks at what searches have reached

_POLL_SECONDS = 0.05
_GRACE_SECONDS = 2.0


@dataclass(frozen=True, eq=False)
class Found:
    """A motion, coefficients `(n, m)`, that search `number` ended with.

    It is `whole` if the search came to its end, not only to the end of the time.
    """

    number: int
    x: Array
    criterion_value: float
    whole: bool


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What the searches found, the best first, and how many of them came to their end.

    The `course` is time [s] and criterion of every improvement, also within a search. The user
    `stopped` the searches before the time; something else `killed` so many processes.
    """

    best: tuple[Found, ...]
    searches: int
    course: tuple[tuple[float, float], ...]
    stopped: bool
    killed: int = 0


@dataclass(frozen=True)
class SearchBudget:
    """How much is searched, and after how many `searches` to stop before that, if at all.

    All cores search if `processes` is `None`.
    """

    seconds: float
    searches: int | None = None
    processes: int | None = 1
    seed: int = 0

    @property
    def useful(self) -> int:
        """Processes that have something to search."""
        processes = self.processes or os.cpu_count() or 1
        return processes if self.searches is None else min(processes, self.searches)


def search_in_parallel(
    tables: Tables, problem: Problem, method: str, effort: SearchBudget, progress: Progress = silent
) -> SearchResult:
    """Search until the time is spent; the best so far if the watcher stops it.

    Every process builds the `problem` of the `tables` anew.

    Raises:
        DataError: No search found a motion (`NoMotion`: none keeps everything).
        Stopped: The watcher stopped them before one was found.
    """
    begun = time.monotonic()
    found, course, stopped = list[Found](), list[tuple[float, float]](), False
    ends, refused, looked = list[int](), list[DataError](), 0.0
    with _workers(tables, method, effort) as messages:
        try:
            for line in _lines(messages, effort, begun, found, ends, refused, progress):
                passed = time.monotonic() - begun
                if "reached" in line:
                    if passed - looked >= LOOKING_SECONDS:
                        course.append((passed, problem.criterion_value(np.array(line["reached"]))))
                        looked = time.monotonic() - begun
                    continue
                x = np.array(line["x"])
                value = problem.criterion_value(x)
                course.append((passed, value))
                found.append(Found(line["number"], x, value, line["whole"]))
                found.sort(key=lambda f: (f.criterion_value, f.number))
        except Stopped:
            if not found:
                raise
            stopped = True
    killed = [code for code in ends if code]
    if not found:
        raise refused[0] if refused else _no_motion_error(killed)
    whole = sum(f.whole for f in found)
    steps = _improvements(course, found[0].criterion_value)
    return SearchResult(tuple(found[:KEPT_MOTIONS]), whole, steps, stopped, len(killed))


def _improvements(
    course: Sequence[tuple[float, float]], least: float
) -> tuple[tuple[float, float], ...]:
    """Times at which a value was below all before, down to that of the best motion."""
    steps = list[tuple[float, float]]()
    for passed, value in course:
        if value >= least and (not steps or value < steps[-1][1]):
            steps.append((passed, value))
    return tuple(steps)


def _no_motion_error(exit_codes: Sequence[int]) -> DataError:
    """No motion: the time was too short, or processes were ended from outside."""
    if exit_codes:
        how = f"signal {-exit_codes[0]}" if exit_codes[0] < 0 else f"exit code {exit_codes[0]}"
        return DataError(
            f"{len(exit_codes)} search processes ended early ({how}), and none found a motion",
            where="search processes",
            fix="signal 9 often means too little memory: try fewer with --processes",
        )
    return DataError(
        "no motion was found in the time given",
        where="excitation",
        fix="give more time with --budget; the first motion takes about 2 s, longer with collision",
    )


def _lines(
    messages: "queue.Queue[Any]",
    effort: SearchBudget,
    begun: float,
    found: Sequence[Found],
    ends: list[int],
    refused: list[DataError],
    progress: Progress,
) -> Iterator[dict[str, Any]]:
    """What the processes say, until all of them have ended; then `ends` has their exit codes.

    Searches that found no way to begin go into `refused`.
    """
    while len(ends) < effort.useful:
        spent = time.monotonic() - begun
        note = f"best {found[0].criterion_value:.4g} of {len(found)}" if found else ""
        searched = 0.0 if effort.searches is None else len(found) / effort.searches
        done = effort.seconds * min(max(spent / effort.seconds, searched), 1.0)
        report_progress(progress, "designing", done, effort.seconds, note)
        if spent > effort.seconds + _GRACE_SECONDS and found:
            return
        try:
            line = messages.get(timeout=_POLL_SECONDS)
        except queue.Empty:
            continue
        if "ended" in line:
            ends.append(line["ended"])
        elif "error" in line:
            kind = NoMotion if line["none"] else DataError
            error = kind(line["error"], where=line["where"], fix=line["fix"])
            if not line["none"]:
                raise error
            refused.append(error)
        elif "broken" in line:
            raise RuntimeError(f"a search process failed:\n{line['broken']}")
        else:
            yield line


@contextmanager
def _workers(tables: Tables, method: str, effort: SearchBudget) -> Iterator["queue.Queue[Any]"]:
    """What processes say that search; sessions of their own keep Ctrl-C from them."""
    messages: queue.Queue[Any] = queue.Queue()
    with ExitStack() as stack:
        for number in range(effort.useful):
            process = subprocess.Popen(
                module_command("steelyard.excite.search.parallel_search"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                start_new_session=True,
            )
            listener = threading.Thread(target=_read_worker, args=(process, messages), daemon=True)
            listener.start()
            stack.callback(_end_worker, process, listener)
            assert process.stdin is not None
            with suppress(BrokenPipeError):
                process.stdin.write(task_of(tables, method, effort, number))
                process.stdin.flush()
        yield messages


def _end_worker(process: "subprocess.Popen[bytes]", listener: threading.Thread) -> None:
    process.kill()
    listener.join()
    assert process.stdin is not None and process.stdout is not None
    with suppress(BrokenPipeError):
        process.stdin.close()
    process.stdout.close()


def task_of(tables: Tables, method: str, effort: SearchBudget, number: int) -> bytes:
    """What a process searches: every so many of the searches, from `number` on."""
    until = time.time() + effort.seconds
    searches = range(number, sys.maxsize if effort.searches is None else effort.searches)
    # places in the robot file are functions, which have no pickle; nothing asks for them there
    tables = (replace(tables[0], where=str), *tables[1:])
    return pickle.dumps((tables, method, effort.seed, until, searches[:: effort.useful]))


def _read_worker(process: "subprocess.Popen[bytes]", messages: "queue.Queue[Any]") -> None:
    """Put what a process says into the queue, and its exit code; half a line is none."""
    assert process.stdout is not None
    for line in process.stdout:
        if line.endswith(b"\n"):
            messages.put(json.loads(line))
    messages.put({"ended": process.wait()})


RESERVED_SECONDS = 2.2  # processor time of start, certificate, report and files [s]
RESERVED_EVALUATIONS = 50.0  # what they take beyond that, in times that a look at the motion takes
MOST_RESERVED_SHARE = 0.35  # share of the whole time that is kept for them at most


@dataclass(frozen=True)
class ProcessPace:
    """How fast this process gets on since its start, in clock and processor times [s]."""

    clock: float = field(default_factory=time.monotonic)
    processor: float = field(default_factory=time.process_time)

    @property
    def slower(self) -> float:
        """Seconds of the clock for one of the processor; 1 at least."""
        processor = max(time.process_time() - self.processor, 1e-3)
        return max((time.monotonic() - self.clock) / processor, 1.0)


def time_after(problem: Problem, seconds: float, pace: ProcessPace) -> float:
    """Time to keep for what comes after the search [s], of the seconds of the whole design."""
    slower = pace.slower
    # processor time that it takes to find out what a motion shows, with its code there
    still = problem.basis.still(np.zeros(problem.robot.n))
    problem.objective(still, 1.0)
    problem.criterion_value(still)
    start = time.process_time()
    problem.criterion_value(still)
    reserved = slower * (RESERVED_SECONDS + RESERVED_EVALUATIONS * (time.process_time() - start))
    return min(reserved, MOST_RESERVED_SHARE * seconds)


TELLING_SECONDS = 0.1  # between two lines of what a search has reached


def main() -> None:
    """Search until the end of the time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answer = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    tables, method, seed, until, searches = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def tell(line: dict[str, Any]) -> None:
        answer.write(json.dumps(line) + "\n")
        answer.flush()

    for line in explained_answers(tables, method, seed, until, searches, tell):
        tell(line)


def explained_answers(
    tables: Tables,
    method: str,
    seed: int,
    until: float,
    searches: Iterable[int],
    tell: Callable[[dict[str, Any]], None] = lambda line: None,
) -> Iterator[dict[str, Any]]:
    """Do a task of `parallel_search` until a time of `time.time`; say last what went wrong.

    What a search has reached is told now and then.
    """
    watch, told = Deadline(until - time.time() + time.monotonic()), time.monotonic()

    def watched(x: Array) -> None:
        nonlocal told
        watch(x)
        if time.monotonic() - told >= TELLING_SECONDS:
            told = time.monotonic()
            tell({"reached": x.tolist()})

    number = 0
    try:
        problem = build(*tables)
        for number in searches:
            x = method_of(method)(problem, seeded(seed, number), watched)
            yield {"number": number, "x": x.tolist(), "whole": True}
    except Stopped:
        for x in watch.latest:
            yield {"number": number, "x": x.tolist(), "whole": False}
    except SteelyardError as error:
        message = {"error": error.wrong, "where": error.where, "fix": error.fix}
        yield {**message, "none": isinstance(error, NoMotion)}
    except Exception:
        yield {"broken": traceback.format_exc()}


def _end_with_parent() -> None:
    """Nothing more comes on standard input: who reads us is gone, or has enough.

    Read without Python's buffer: at its end Python cannot take that from a thread that waits.
    """
    while os.read(0, 4096):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()

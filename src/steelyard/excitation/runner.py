"""Searches side by side, in processes of their own."""

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.build import Recipe
from steelyard.excitation.problem import Problem
from steelyard.progress import Progress, Stopped, silent, tell

KEPT = 4
"""Best motions that are kept for the end."""

_TICK = 0.05
_GRACE = 2.0


@dataclass(frozen=True, eq=False)
class Found:
    """A motion that a search ended with.

    Attributes:
        number: Of the search.
        x: Coefficients, shape `(n, m)`.
        figure: The criterion.
        seconds: When, since the searches began [s].
        whole: Whether the search came to its end, not only to the end of the time.
    """

    number: int
    x: Array
    figure: float
    seconds: float
    whole: bool


@dataclass(frozen=True, eq=False)
class Harvest:
    """What the searches found.

    Attributes:
        best: The best of them, best first.
        searches: Searches that came to their end.
        course: Time [s] and figure of every improvement.
        stopped: Whether the user stopped them before the time.
    """

    best: tuple[Found, ...]
    searches: int
    course: tuple[tuple[float, float], ...]
    stopped: bool


@dataclass(frozen=True)
class Effort:
    """How much is searched.

    Attributes:
        seconds: How long.
        searches: After how many to stop before that; `None` for never.
        processes: How many search side by side.
        seed: Same seed, same searches.
    """

    seconds: float
    searches: int | None = None
    processes: int = 1
    seed: int = 0


def harvested(
    recipe: Recipe, problem: Problem, method: str, effort: Effort, progress: Progress = silent
) -> Harvest:
    """Search until the time is spent; the best so far if the watcher stops it.

    Args:
        recipe: From which every process builds the problem.
        problem: The same, built.
        method: Name of the search method.
        effort: How much is searched.
        progress: Told how much time is spent, and of the best figure.

    Raises:
        DataError: No search found a motion.
    """
    begun = time.monotonic()
    found, course, stopped = list[Found](), list[tuple[float, float]](), False
    with _workers(recipe, method, effort) as said:
        try:
            for line in _lines(said, effort, begun, found, progress):
                x = np.array(line["x"])
                one = Found(
                    line["number"], x, problem.figure(x), time.monotonic() - begun, line["whole"]
                )
                if not found or one.figure < found[0].figure:
                    course.append((one.seconds, one.figure))
                found.append(one)
                found.sort(key=lambda f: (f.figure, f.number))
        except Stopped:
            stopped = True
    if not found:
        raise DataError(
            "no motion was found in the time given" if not stopped else "stopped too early",
            where="excitation",
            mend="give more time with --budget; the first motion takes a second or two, longer "
            "with collision",
        )
    whole = sum(f.whole for f in found)
    return Harvest(tuple(found[:KEPT]), whole, tuple(course), stopped)


def _lines(
    said: "queue.Queue[Any]",
    effort: Effort,
    begun: float,
    found: list[Found],
    progress: Progress,
) -> Iterator[dict[str, Any]]:
    """What the processes say, until all of them have ended."""
    running = effort.processes
    while running:
        spent = time.monotonic() - begun
        note = f"best {found[0].figure:.4g} of {len(found)}" if found else ""
        tell(progress, "designing", min(spent, effort.seconds), effort.seconds, note)
        if spent > effort.seconds + _GRACE and found:
            return
        try:
            line = said.get(timeout=_TICK)
        except queue.Empty:
            continue
        if line is None:
            running -= 1
        elif "error" in line:
            raise DataError(line["error"], where=line["where"], mend=line["mend"])
        else:
            yield line


@contextmanager
def _workers(recipe: Recipe, method: str, effort: Effort) -> Iterator["queue.Queue[Any]"]:
    """Processes that search, and the queue of what they say; `None` when one has ended."""
    said: queue.Queue[Any] = queue.Queue()
    processes = [_worker(recipe, method, effort, k, said) for k in range(effort.processes)]
    try:
        yield said
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def _worker(
    recipe: Recipe, method: str, effort: Effort, number: int, said: "queue.Queue[Any]"
) -> "subprocess.Popen[str]":
    task = {
        "problem": asdict(recipe),
        "method": method,
        "seed": effort.seed,
        "seconds": effort.seconds,
        "first": number,
        "step": effort.processes,
        "searches": effort.searches,
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "steelyard.excitation.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )
    assert process.stdin is not None
    process.stdin.write(json.dumps(task) + "\n")
    process.stdin.flush()
    threading.Thread(target=_hear, args=(process, said), daemon=True).start()
    return process


def _hear(process: "subprocess.Popen[str]", said: "queue.Queue[Any]") -> None:
    assert process.stdout is not None
    for line in process.stdout:
        said.put(json.loads(line))
    said.put(None)

"""A process of its own that searches: `python -m steelyard.excite.search.worker_process`.

It reads one pickle, the task, and writes one line of JSON per search, `{"number", "x", "whole"}`;
when its time is spent it writes what it has reached, and ends. On the way it writes lines
`{"reached"}`, the coefficients of a search so far. What goes wrong is a line too. It
ends when its standard input is closed: nobody reads it any more.
"""

import json
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.base.progress import Stopped

if TYPE_CHECKING:
    from steelyard.excite.design_problem_from_tables import Tables


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
    tables: "Tables",
    method: str,
    seed: int,
    until: float,
    searches: Iterable[int],
    tell: Callable[[dict[str, Any]], None] = lambda line: None,
) -> Iterator[dict[str, Any]]:
    """Do a task of `parallel_search` until a time of `time.time`; say last what went wrong.

    What a search has reached is told now and then.
    """
    from steelyard.excite.design_problem_from_tables import build
    from steelyard.excite.search.feasibility import NoMotion
    from steelyard.excite.search.margins_barrier_and_newton import Deadline
    from steelyard.excite.search.search_methods import method_of, seeded

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

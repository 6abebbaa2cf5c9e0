"""A process of its own that searches: `python -m steelyard.excite.search.worker`.

It reads one line of JSON, the task, and writes one line per search, `{"number", "x", "whole"}`;
when its time is spent it writes what it has reached, and ends. What goes wrong is a line too. It
ends when its standard input is closed: nobody reads it any more.
"""

import json
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from itertools import count
from typing import Any

from steelyard.base.errors import SteelyardError
from steelyard.base.progress import Stopped


def main() -> None:
    """Search until the end of the time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answer = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    task = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for line in _explained(answers(task, task["until"] - time.time() + time.monotonic())):
        answer.write(json.dumps(line) + "\n")
        answer.flush()


def _explained(lines: Iterator[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """The lines, and a last one of what went wrong."""
    try:
        yield from lines
    except SteelyardError as error:
        from steelyard.excite.search.feasibility import NoMotion

        message = {"error": error.wrong, "where": error.where, "fix": error.fix}
        yield {**message, "none": isinstance(error, NoMotion)}
    except Exception:
        yield {"broken": traceback.format_exc()}


def answers(task: Mapping[str, Any], deadline: float) -> Iterator[dict[str, Any]]:
    """Do a task that `parallel_search` described, as long as there is time."""
    from steelyard.excite.problem_from_tables import Recipe
    from steelyard.excite.search.newton import Deadline
    from steelyard.excite.search.population import method_of, seeded

    problem, method = Recipe(**task["problem"]).problem(), method_of(task["method"])
    watch = Deadline(deadline)
    for number in count(task["first"], task["step"]):
        if task["searches"] is not None and number >= task["searches"]:
            return
        try:
            x = method.search(problem, seeded(task["seed"], number), watch)
        except Stopped:
            if watch.latest:
                yield {"number": number, "x": watch.latest[0].tolist(), "whole": False}
            return
        yield {"number": number, "x": x.tolist(), "whole": True}


def _end_with_parent() -> None:
    """Nothing more comes on standard input: who reads us is gone, or has enough.

    Read without Python's buffer: at its end Python cannot take that from a thread that waits.
    """
    while os.read(0, 4096):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()

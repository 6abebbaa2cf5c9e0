"""The process of one work: `python -m steelyard.app.work_process`, told what to do by its input.

The first line of standard input is the work as JSON. The line `stop` stops it at the next event of
progress; the end of the input, as when the server is killed, ends it at once. Each line of
standard output is an event. The result, or the error, is a JSON file that is there whole or not at
all; a work that was stopped, or that died, has none.
"""

import json
import os
import sys
import threading
import traceback
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from steelyard.base.errors import SteelyardError
from steelyard.base.files import remove_unfinished, whole_file
from steelyard.base.progress import Event, Progress, Stopped

BEHIND_PAGES = 5  # by how much the priority is less than that of server and browser
LONGEST_WORDS = 2000  # letters of an error, which may quote a file

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """Do the work, and write its result."""
    said = json.loads(sys.stdin.buffer.readline())
    if sys.platform != "win32":
        os.nice(BEHIND_PAGES)
    with suppress(OSError):  # Linux: between sessions, each of which may be a group of its own
        Path("/proc/self/autogroup").write_text(str(BEHIND_PAGES))
    events = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what libraries print is no event
    stop = threading.Event()
    threading.Thread(target=_listen, args=(stop,), daemon=True).start()

    def progress(event: Event) -> bool:
        values = [event.phase, event.done, event.total, event.note]
        events.write(json.dumps(values) + "\n")
        events.flush()
        return not stop.is_set()

    finish(said["function"], said["given"], Path(said["out"]), progress)


def finish(function: str, given: Mapping[str, Any], out: Path, progress: Progress) -> None:
    """Do a work, and write its result or its error; nothing if it is stopped."""
    module, name = function.split(":")
    try:
        found = {"result": getattr(import_module(module), name)(**given, progress=progress)}
    except Stopped:
        return
    except SteelyardError as error:
        said = {"wrong": error.wrong, "where": error.where, "fix": error.fix}
        found = {"error": {name: text[:LONGEST_WORDS] for name, text in said.items()}}
    except Exception as error:
        found = {"error": _defect(error)}
    out.parent.mkdir(exist_ok=True)  # it may be removed at any time
    with whole_file(out) as part:
        part.write_text(json.dumps(found, allow_nan=False), encoding="utf-8")


def _defect(error: Exception) -> dict[str, Any]:
    place = traceback.extract_tb(error.__traceback__)[-1]
    return {
        "wrong": f"a defect of steelyard: {type(error).__name__}: {error}",
        "where": f"{Path(place.filename).name}, line {place.lineno}",
        "fix": "report it, if possible with the files of the workspace",
    }


def _listen(stop: threading.Event) -> None:
    """Note a stop; without a server to work for, end at once and leave no part of a file."""
    for line in sys.stdin.buffer:
        if line.strip() == b"stop":
            stop.set()
    remove_unfinished()
    os._exit(1)


if __name__ == "__main__":
    main()

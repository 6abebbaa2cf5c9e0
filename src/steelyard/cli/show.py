"""What the commands show while they work: a progress bar on standard error."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from steelyard.cli import interrupt
from steelyard.progress import Event, Progress


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A watcher that draws one bar per phase, and is gone when the work is done."""
    from rich.console import Console
    from rich.progress import BarColumn, TaskID, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    bars = Bars(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
        console=Console(file=sys.stderr),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    tasks: dict[str, TaskID] = {}

    def watch(event: Event) -> bool:
        interrupt.check()
        if event.phase not in tasks:
            for task in tasks.values():
                bars.remove_task(task)
            tasks.clear()
            tasks[event.phase] = bars.add_task(event.phase, total=event.total, note=event.note)
        bars.update(tasks[event.phase], completed=event.done, total=event.total, note=event.note)
        return True

    with bars:
        yield watch

"""A progress bar on standard error; results that are printed, and written where wanted."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from steelyard.cli import interrupt
from steelyard.progress import Event, Progress

if TYPE_CHECKING:
    from rich.console import Console


class Result(Protocol):
    """What a command found: numbers for JSON, files in a folder, lines of the terminal."""

    def to_dict(self) -> dict[str, Any]:
        """The numbers."""
        ...

    def write(self, folder: Path) -> None:
        """Write report and tables to a folder."""
        ...

    def show(self, console: "Console") -> None:
        """Print it."""
        ...


R = TypeVar("R", bound=Result)


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


def computed(
    compute: Callable[[Progress], R], output: Path | None, as_json: bool, **files: str
) -> R:
    """Compute a result with a progress bar, write it if wanted, and print it.

    Args:
        compute: Computes it.
        output: Folder to write it to, whole or not at all; none if `None`.
        as_json: Whether to print it as JSON.
        **files: Names of written files that the terminal lists, by what they are.
    """
    import typer
    from rich.console import Console

    from steelyard.files import new_folder, whole_folder

    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress:
        found = compute(progress)
        if folder is not None:
            with whole_folder(folder) as part:
                found.write(part)
                interrupt.too_late()
    if as_json:
        typer.echo(json.dumps(found.to_dict(), allow_nan=False))
        return found
    found.show(Console())
    if folder is not None:
        lines = (f"{kind:<7} {folder / name}" for kind, name in files.items())
        typer.echo("\n".join(["", *lines]))
    return found

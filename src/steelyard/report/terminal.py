"""The console that results are printed on; text of strangers cannot command the terminal."""

from typing import IO

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook, RenderResult
from rich.segment import Segment

from steelyard.base.errors import visible


class _Visible:
    """A renderable whose text is shown with control characters escaped."""

    def __init__(self, shown: ConsoleRenderable) -> None:
        self.shown = shown

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for segment in console.render(self.shown, options):
            escaped = Segment(visible(segment.text, "\n"), segment.style)
            yield segment if segment.control else escaped


class _ShowControls(RenderHook):
    """Escapes what is printed; colours and cursor movements of the program itself stay."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [_Visible(shown) for shown in renderables]


def terminal(file: IO[str] | None = None, width: int | None = None) -> Console:
    """A console, on standard output if no file is given, that escapes control characters."""
    console = Console(file=file, width=width)
    console.push_render_hook(_ShowControls())
    return console

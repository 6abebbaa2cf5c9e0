"""`steelyard log`: what is in a log, and logs in other formats."""

import json
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from steelyard.formats.contents import LogContent

log = typer.Typer(
    name="log", help="List the contents of logs, and convert them.", no_args_is_help=True
)


@log.command()
@guarded
def info(
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    as_json: Json = False,
) -> None:
    """List rows, duration, rate and columns of logs.

    Example: steelyard log info run.csv
    """
    from rich.console import Console

    from steelyard.cli.show import progress_bar
    from steelyard.formats import open_log, parse_log_argument
    from steelyard.formats.contents import content_of

    found = []
    for text in logs:
        path, cut = parse_log_argument(text)
        with progress_bar() as progress:
            found.append(content_of(open_log(path), cut, progress))
    if as_json:
        typer.echo(json.dumps([content.to_dict() for content in found], allow_nan=False))
        return
    for content in found:
        show(content, Console())


@log.command()
@guarded
def convert(
    source: Annotated[str, typer.Argument(help=LOG_HELP, metavar="LOG")],
    output: Annotated[
        Path,
        typer.Argument(
            help="File to write: .csv, .parquet, .npz, .mat or .h5; must not exist.",
            metavar="OUTPUT",
        ),
    ],
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--columns",
            help="Columns to write, in this order; * is a wildcard. All if unset.",
            metavar="NAME...",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Convert a log, or a part of it, to another format; no number is changed.

    Example: steelyard log convert run.mcap@1:5 run.csv --columns "/joint_states/*"
    """
    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import whole_file
    from steelyard.formats import open_log, parse_log_argument
    from steelyard.formats.contents import with_progress
    from steelyard.formats.log import require_columns
    from steelyard.formats.window import windowed
    from steelyard.formats.writers import writer_for

    path, cut = parse_log_argument(source)
    opened = open_log(path)
    wanted = chosen(opened.columns, columns or [])
    require_columns(path, opened.columns, wanted)
    writer = writer_for(output)
    rows = 0
    with progress_bar() as progress, whole_file(output) as part:
        with writer(part, wanted) as write:
            for table in with_progress(windowed(opened, wanted, cut), opened, progress, "writing"):
                write(table)
                rows += len(table)
        interrupt.too_late()
    if as_json:
        facts = {"output": str(output), "rows": rows, "columns": list(wanted)}
        typer.echo(json.dumps(facts))
        return
    typer.echo(f"wrote {output}: {rows} rows of {len(wanted)} columns")


def chosen(known: tuple[str, ...], patterns: list[str]) -> tuple[str, ...]:
    """The columns that names and patterns stand for; a pattern that fits none stays a name."""
    names: list[str] = []
    for pattern in patterns:
        fitting = [pattern] if pattern in known else [n for n in known if fnmatchcase(n, pattern)]
        names += fitting or [pattern]
    return tuple(dict.fromkeys(names)) if patterns else tuple(known)


def show(content: "LogContent", console: "Console") -> None:
    """Print what is in a log."""
    facts = [content.format, size_text(content.size), f"{content.rows} rows"]
    if content.duration is not None:
        facts.append(f"{content.duration:.6g} s")
    if content.rate is not None:
        facts.append(f"{content.rate:.6g} Hz")
    console.print(content.path, style="bold", highlight=False, markup=False)
    console.print(", ".join(facts), highlight=False)
    if content.time is not None:
        line = f"time is '{content.time.name}' in {content.time.unit}"
        console.print(line, highlight=False, markup=False)
    for remark in content.remarks:
        console.print(f"note  {remark}", highlight=False, markup=False)
    console.print(_columns(content))
    if content.topics:
        console.print(_topics(content))
    for name, why in content.left_out:
        console.print(f"left out  {name}: {why}", highlight=False, markup=False)
    console.print()


def size_text(size: int) -> str:
    """Bytes in the unit that fits."""
    value, units = float(size), ["B", "KiB", "MiB", "GiB", "TiB"]
    while value >= 1024.0 and len(units) > 1:
        value /= 1024.0
        units.pop(0)
    return f"{value:.4g} {units[0]}"


def _columns(content: "LogContent") -> "Table":
    table = _table("column", "kind", "first", "least", "greatest", "missing")
    for column in content.columns:
        numbers = [
            "" if x is None else f"{x:.6g}" for x in (column.first, column.least, column.most)
        ]
        missing = f"{100.0 * column.missing:.3g} %" if column.missing else ""
        table.add_row(_text(column.name), column.kind, *numbers, missing)
    return table


def _topics(content: "LogContent") -> "Table":
    table = _table("topic", "type", "messages", "rate", "")
    for topic in content.topics:
        rate = f"{topic['rate']:.4g} Hz" if topic["rate"] else ""
        table.add_row(
            _text(topic["name"]), _text(topic["type"]), str(topic["count"]), rate,
            _text(topic["problem"])
        )  # fmt: skip
    return table


def _table(*headings: str) -> "Table":
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in headings:
        right = heading in ("first", "least", "greatest", "missing", "messages", "rate")
        table.add_column(heading, justify="right" if right else "left", overflow="fold")
    return table


def _text(name: str) -> "Text":
    from rich.text import Text

    return Text(name)

"""The commands `check` and `log`: what is wrong with logs, and what is in them."""

from collections.abc import Sequence
from contextlib import ExitStack
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from steelyard.base.errors import ModelError, visible
from steelyard.base.files import whole_file, whole_folder
from steelyard.cli import interrupt
from steelyard.cli import shared_by_commands as shared
from steelyard.cli.commands_from_functions import DerivedCommand, from_function

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from steelyard.check.check import CheckResult
    from steelyard.fleet.informative_stretches import InformativeStretches
    from steelyard.logs.contents import LogContent

WHAT_TO_COMPARE = (
    "compare signs, gear ratios, couplings, position_offset and units in the robot file with the "
    "data sheet, or give --model"
)
"""What to do where the logs do not decide whether the robot file is right."""

WHAT_TO_COMPARE_OF_GEARS = (
    "compare signs of ratios and couplings in [robot.transmission] with the data sheet, or log "
    "each joint moving alone: a second motor that turns is coupled; compare directions with the "
    "model file"
)
"""What to do where the logs do not decide whether the gears are right."""

WHAT_DECIDES_GAINS = (
    "gains: a log with a load of known mass (identify --loaded); payload: a log without it, and "
    "--model from runs known to be correct"
)
"""What decides gains and payload where the nominal model does not."""


@from_function(
    "steelyard:check",
    model={
        "help": "Reference model, identified from runs without payload, contact or wrong signals: "
        "model.json or its folder.",
        "metavar": "MODEL",
    },
    fix={
        "help": "Write a corrected robot file and check again; ROBOT-fixed.toml if no FILE.toml "
        "follows.",
        "metavar": "[FILE.toml]",
    },
    verbose={},
)
def check(
    call: "partial[CheckResult]",
    output: Path | None = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Check logs for errors, and propose lines of the robot file that correct them.

    Options:
        output: Output folder for a page with plots and JSON; none if unset.
        verbose: Print what each check found, ok ones too.

    The exit code is 0 if all is ok or open (not decidable from these logs), 1 if something is
    doubtful or the result is inconclusive (the misfit is too large for most checks), 2 if something
    is wrong or the command fails; with --fix it is that of the new robot file.

    Example: steelyard check ur10e.toml run1.csv run2.csv --fix
    """
    from steelyard.cli.actuator_commands import follows_targets, targets_checked
    from steelyard.identify.repeated_motion_and_validation_split import ProposedCut, propose_cut
    from steelyard.report.terminal import terminal
    from steelyard.robot.file.robot_file import load_robot

    folder = shared.optional_folder(output)
    if follows_targets(call.keywords["robot"]):
        return targets_checked(call.keywords, folder, verbose, as_json)
    with shared.progress_bar() as progress, ExitStack() as parts:
        found = call(progress=progress)
        if found.fixed is not None and found.fixed.changes:
            file = parts.enter_context(whole_file(found.fixed.subject.path))
            file.write_text(found.fixed.subject.text, encoding="utf-8")
        if folder is not None:
            found.write(parts.enter_context(whole_folder(folder)))
        interrupt.too_late()
    robot, logs, model = (call.keywords[name] for name in ("robot", "logs", "model"))
    if as_json:
        shared.print_json({**found.to_dict(), "output": folder and str(folder)})
    else:
        found.show(terminal(), verbose)
        given, gains, cluster = ProposedCut(tuple(logs)), True, call.keywords["cluster"]
        if not (model or found.last.severity or cluster):
            changed = found.fixed is not None and found.fixed.changes
            read = found.fixed.subject.path if found.fixed is not None and changed else robot
            try:
                given = propose_cut(load_robot(read, base=call.keywords["fixed_base"]), logs)
            except ModelError:  # a model file and currents: no drive gains, as columns are guessed
                gains = False
        named = [] if model else [robot, *given.logs]
        said = hints(found, folder, named, given.ends, gains=gains, cluster=cluster)
        shared.print_lines(*said, whole=True)
    if found.last.severity:
        raise typer.Exit(int(found.last.severity))


def hints(
    found: "CheckResult",
    folder: Path | None,
    named: Sequence[str],
    ends: str = "",
    *,
    gains: bool = True,
    cluster: str | None = None,
) -> list[str]:
    """Where things are written, or how to have them written; and what to do next.

    `named` are robot file and logs as they were given, to be identified from, else none; `ends`
    says why the log that validates ends before its last row. Without known drive gains a robot
    file is needed for them. Logs that workers checked are identified from by workers.
    """
    from steelyard.identify import verdict_and_next_steps as judging

    lines, used = [""], list(named)
    if found.fixed is not None and found.fixed.changes:
        lines.append(f"robot file  {found.fixed.subject.path}")
        used[:1] = [str(found.fixed.subject.path)]
    if folder is not None:
        lines += [f"page        {folder / 'check.html'}", f"JSON        {folder / 'check.json'}"]
    if found.fixed is None and found.content.diagnosis.edits:
        lines.append("--fix       writes a new robot file with these lines, and checks again")
    if folder is None and found.content.diagnosis.severity:
        lines.append("-o FOLDER   writes a page with the plots")
    file = judging.path_word(used[0] if used else found.content.file)
    steps = judging.gear_side_steps(found.last.findings, file)
    if found.last.inconclusive:
        steps.insert(0, ("", WHAT_TO_COMPARE))
    elif "transmission" in found.last.open_checks:
        steps.insert(0, ("", WHAT_TO_COMPARE_OF_GEARS))
    if found.last.model_open:
        steps.insert(1, ("", WHAT_DECIDES_GAINS))
    if named and not gains:
        words = " ".join(judging.path_word(name) for name in used)
        steps.append((f"steelyard init {words}", "identify needs a robot file for drive gains:"))
    elif named and not found.last.severity:
        steps.append((judging.identify_command(used[0], used[1:], cluster), ends))
    lines += judging.step_lines(tuple(steps), 12)
    return lines if len(lines) > 1 else []


log = typer.Typer(
    name="log", help="List the contents of logs, and convert them.", no_args_is_help=True
)


@log.command(cls=DerivedCommand)
@from_function(
    "steelyard:informative_stretches",
    share={"max": 100.0, "metavar": "PERCENT"},
    window={"metavar": "SECONDS"},
)
def select(call: "partial[InformativeStretches]", as_json: bool = False) -> None:
    """Choose the stretches of production logs that say most about a model's parameters.

    Printed as LOG@START:STOP, a line each; what they hold of all goes to standard error. Windows
    that the model does not explain, as with a payload, are left out. `steelyard identify` takes
    stretches of some seconds, by --window 10; shorter ones are for Python, which has their sums.

    Example: steelyard log select steelyard-ur10e monday.parquet tuesday.parquet --share 95
    """
    with shared.progress_bar() as progress:
        found = call(progress=progress)
    if as_json:
        shared.print_json(found.to_dict())
        return
    for stretch in found.stretches:
        shared.say(stretch.text)
    typer.echo(visible(found.words), err=True)


@log.command(cls=DerivedCommand)
@from_function()
def info(logs: list[str], as_json: bool = False) -> None:
    """List rows, duration, rate and columns of logs.

    Example: steelyard log info run.csv
    """
    from steelyard.logs.contents import content_of
    from steelyard.logs.formats import open_log
    from steelyard.logs.log_and_errors import parse_log_argument
    from steelyard.report.terminal import terminal

    found = []
    for text in logs:
        path, cut = parse_log_argument(text)
        with shared.progress_bar() as progress:
            found.append(content_of(open_log(path), cut, progress))
    if as_json:
        shared.print_json([content.to_dict() for content in found])
        return
    for content in found:
        show_content(content, terminal())


@log.command(cls=DerivedCommand)
@from_function(
    source={"help": shared.LOG_HELP, "metavar": "LOG"},
    output={"metavar": "OUTPUT"},
    columns={"metavar": "NAME..."},
    beside={"metavar": "LOG..."},
)
def convert(
    source: str,
    output: Path,
    columns: list[str] | None = None,
    beside: list[Path] | None = None,
    as_json: bool = False,
) -> None:
    """Convert a log, or a part of it, to another format; no number is changed.

    Options:
        output: File to write: .csv, .parquet, .npz, .mat or .h5; must not exist.
        columns: Columns to write, in this order; * is a wildcard. All if unset.
        beside: Files with the same samples in other columns, joined row by row.

    Example: steelyard log convert run.mcap@1:5 run.csv --columns "/joint_states/*"
    """
    from steelyard.logs.clocks_and_combined_logs import SideBySide
    from steelyard.logs.contents import windowed, with_progress
    from steelyard.logs.formats import open_log, writer_for
    from steelyard.logs.log_and_errors import parse_log_argument, require_columns

    path, cut = parse_log_argument(source)
    opened = open_log(path)
    if beside:
        opened = SideBySide((opened, *map(open_log, beside)))
    wanted = chosen(opened.columns, columns or [])
    require_columns(path, opened.columns, wanted)
    writer = writer_for(output)
    rows = 0
    with shared.progress_bar() as progress, whole_file(output) as part:
        with writer(part, wanted) as write:
            for table in with_progress(windowed(opened, wanted, cut), opened, progress, "writing"):
                write(table)
                rows += len(table)
        interrupt.too_late()
    if as_json:
        shared.print_json({"output": str(output), "rows": rows, "columns": list(wanted)})
        return
    typer.echo(f"wrote {output}: {rows} rows of {len(wanted)} columns")
    if isinstance(opened, SideBySide):
        same = f"; equal in them: {', '.join(opened.shared)}" if opened.shared else ""
        typer.echo(f"note  row k of every file is taken as one sample{same}")


def chosen(known: tuple[str, ...], patterns: list[str]) -> tuple[str, ...]:
    """The columns that names and patterns stand for; a pattern that fits none stays a name."""
    names: list[str] = []
    for pattern in patterns:
        fitting = [pattern] if pattern in known else [n for n in known if fnmatchcase(n, pattern)]
        names += fitting or [pattern]
    return tuple(dict.fromkeys(names)) if patterns else tuple(known)


def show_content(content: "LogContent", console: "Console") -> None:
    """Print what is in a log."""
    facts = [content.format, size_text(content.size), f"{content.rows} rows"]
    if content.duration is not None:
        facts.append(f"{content.duration:.6g} s")
    if content.rate is not None:
        facts.append(f"{content.rate:.6g} Hz")
    lines = [", ".join(facts)]
    if content.time is not None:
        lines.append(f"time is '{content.time.name}' in {content.time.unit}")
    lines += [f"note  {remark}" for remark in content.remarks]
    console.print(content.path, style="bold", highlight=False, markup=False)
    for line in lines:
        console.print(line, highlight=False, markup=False)
    columns = []
    for column in content.columns:
        numbers = (column.first, column.least, column.most)
        missing = f"{100.0 * column.missing:.3g} %" if column.missing else ""
        texts = ("" if x is None else f"{x:.6g}" for x in numbers)
        columns.append((column.name, column.kind, *texts, missing))
    console.print(_table("column kind first least greatest missing".split(), columns))
    topics = []
    for topic in content.topics:
        rate = f"{topic['rate']:.4g} Hz" if topic["rate"] else ""
        topics.append((topic["name"], topic["type"], str(topic["count"]), rate, topic["problem"]))
    if topics:
        console.print(_table(["topic", "type", "messages", "rate", ""], topics))
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


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> "Table":
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in headings:
        words = heading in ("column", "kind", "topic", "type", "")
        table.add_column(heading, justify="left" if words else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(visible(cell)) for cell in row))
    return table

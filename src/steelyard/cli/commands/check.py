"""`steelyard check`: what is wrong with logs, or with what the robot file says of them."""

import json
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, FixedBase, Json, RobotArgument, Verbose

if TYPE_CHECKING:
    from steelyard.identification.checks.check import CheckResult


COMPARE = (
    "compare signs, gear ratios, couplings, position_offset and units in the robot file with the "
    "data sheet, or give --model"
)
"""What to do where the logs do not decide whether the robot file is right."""

GEARS = (
    "compare signs of ratios and couplings in [robot.transmission] with the data sheet, or log "
    "each joint moving alone: a second motor that turns is coupled; compare directions with the "
    "model file"
)
"""What to do where the logs do not decide whether the gears are right."""

LOADED = (
    "gains: a log with a load of known mass (identify --loaded); payload: a log without it, and "
    "--model from runs known to be correct"
)
"""What decides gains and payload where the nominal model does not."""


@guarded
def check(
    robot: RobotArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    model: Annotated[
        str | None,
        typer.Option(
            help="Reference model, identified from runs without payload, contact or wrong signals: "
            "model.json or its folder.",
            metavar="MODEL",
        ),
    ] = None,
    fix: Annotated[
        str | None,
        typer.Option(
            help="Write a corrected robot file and check again; ROBOT-fixed.toml "
            "if no FILE.toml follows.",
            metavar="[FILE.toml]",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the checks that `identify` makes before the fit.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Output folder for a page with plots and JSON; none if unset."
        ),
    ] = None,
    fixed_base: FixedBase = None,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Check logs for errors, and propose lines of the robot file that correct them.

    The exit code is 0 if all is ok or open (not decidable from these logs), 1 if something is
    doubtful or the result is inconclusive (the misfit is too large for most checks), 2 if something
    is wrong or the command fails; with --fix it is that of the new robot file.

    Example: steelyard check ur10e.toml run1.csv run2.csv --fix
    """
    from rich.console import Console
    from rich.text import Text

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.errors import ModelError
    from steelyard.files import new_folder, whole_file, whole_folder
    from steelyard.identification.checks.check import check as checked
    from steelyard.identification.proposed_cut import Parted, parted
    from steelyard.robot_file.file import load_robot

    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress:
        found = checked(
            robot,
            logs,
            model,
            fix=fix,
            quick=quick,
            fixed_base=fixed_base,
            progress=progress,
        )
        with ExitStack() as parts:
            if found.fixed is not None and found.fixed.changes:
                file = parts.enter_context(whole_file(found.fixed.subject.path))
                file.write_text(found.fixed.subject.text, encoding="utf-8")
            if folder is not None:
                found.write(parts.enter_context(whole_folder(folder)))
            interrupt.too_late()
    if as_json:
        typer.echo(
            json.dumps({**found.to_dict(), "output": folder and str(folder)}, allow_nan=False)
        )
    else:
        console = Console()
        found.show(console, verbose)
        given, gains = Parted(tuple(logs)), True
        if not (model or found.last.severity):
            changed = found.fixed is not None and found.fixed.changes
            read = found.fixed.subject.path if found.fixed is not None and changed else robot
            try:
                given = parted(load_robot(read, base=fixed_base), logs)
            except ModelError:  # a model file and currents: no drive gains, as columns are guessed
                gains = False
        named = [] if model else [robot, *given.logs]
        for line in hints(found, folder, named, given.ends, gains=gains):
            console.print(Text(line), soft_wrap=True)
    if found.last.severity:
        raise typer.Exit(int(found.last.severity))


def hints(
    found: "CheckResult",
    folder: Path | None,
    named: Sequence[str],
    ends: str = "",
    *,
    gains: bool = True,
) -> list[str]:
    """Where things are written, or how to have them written; and what to do next.

    Args:
        found: What was found.
        folder: Of the page, if there is one.
        named: Robot file and logs as they were given, to be identified from; else empty.
        ends: Why the log that validates ends before its last row, if it does.
        gains: Whether the drive gains are known; if not, a robot file is needed for them.
    """
    from steelyard.report.text.next_steps import (
        gear_side_steps,
        identifying,
        path_word,
        step_lines,
    )

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
    file = path_word(used[0] if used else found.content.file)
    steps = gear_side_steps(found.last.findings, file)
    if found.last.inconclusive:
        steps.insert(0, ("", COMPARE))
    elif "transmission" in found.last.open_checks:
        steps.insert(0, ("", GEARS))
    if found.last.model_open:
        steps.insert(1, ("", LOADED))
    if named and not gains:
        words = " ".join(path_word(name) for name in used)
        steps.append((f"steelyard init {words}", "identify needs a robot file for drive gains:"))
    elif named and not found.last.severity:
        steps.append((identifying(used[0], used[1:]), ends))
    lines += step_lines(tuple(steps), 12)
    return lines if len(lines) > 1 else []

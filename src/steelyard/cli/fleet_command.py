"""`steelyard fleet`: many robots over many days, in parts, on one machine or a cluster."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli import interrupt
from steelyard.cli import shared_by_commands as shared
from steelyard.cli.commands_from_functions import from_function

if TYPE_CHECKING:
    from steelyard.fleet.fleet_result_and_page import Fleet


@from_function(
    "steelyard:fleet",
    logs={
        "help": "Logs, folders of logs, quoted patterns with *, or URLs (s3://, gs://, file://); "
        "or a table of them: CSV with the columns log, robot, day and, if known, temperature.",
        "metavar": "LOG...",
    },
    temperature={"metavar": "COLUMN..."},
    names={"metavar": "PATTERN"},
    store={"metavar": "FOLDER"},
    cluster={"metavar": "ADDRESS"},
    false_alarms={"metavar": "NUMBER"},
)
def fleet(
    call: "partial[Fleet]",
    plan: bool = False,
    output: Annotated[Path | None, shared.output_folder("steelyard-ROBOT-fleet")] = None,
    as_json: bool = False,
) -> None:
    """Find which robots of one kind changed, in what, and since when, from logs of many days.

    All share one model of bodies; friction, offsets, gains and what the last link carries are each
    robot's and day's own. What was worked on is remembered: the next time only new logs are read,
    and Ctrl-C loses nothing. The folder gets report.html, fleet.json, robots.jsonl (a line a
    robot, for monitoring) and model.json, which all other commands take.

    Options:
        plan: Print parts, bytes, time and memory of the work, measured on one part, and end.

    Exit code 0: no robot is changed. 1: one is. 2: error.

    Example: steelyard fleet arm.toml logs --names "{robot}/{day}" -o week20
    """
    from steelyard.fleet.fleet import plan_fleet

    interrupt.kept("logs that are done are remembered; the next run goes on there")
    if plan:
        given = {k: x for k, x in call.keywords.items() if k not in ("cluster", "false_alarms")}
        with shared.progress_bar() as progress:
            found = plan_fleet(**given, progress=progress)
        if as_json:
            shared.print_json(vars(found))
        else:
            typer.echo(str(found))
        return
    folder = shared.robot_folder(output, call.keywords["robot"], "-fleet")
    result = shared.computed(call, folder)
    if as_json:
        shared.print_json({"output": str(folder), **result.to_dict()})
    else:
        shared.show(result)
        files = {"report": "report.html", "robots": "robots.jsonl", "model": "model.json"}
        typer.echo("\n" + shared.file_lines(folder, **files))
    raise typer.Exit(int(bool(result.changed)))

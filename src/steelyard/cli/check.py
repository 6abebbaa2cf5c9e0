"""`steelyard check`: what is wrong with logs, or with what the robot file says of them."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, FixedBase, Json, RobotArgument

if TYPE_CHECKING:
    from steelyard.identification.fix import Fixed
    from steelyard.report.check_page import CheckContent


@guarded
def check(
    robot: RobotArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    model: Annotated[
        str | None,
        typer.Option(
            help="Model identified from clean runs, to compare with: model.json or its folder.",
            metavar="MODEL",
        ),
    ] = None,
    fix: Annotated[
        str | None,
        typer.Option(
            help="Write a new robot file with what was found, and check again; ROBOT-fixed.toml "
            "if no FILE.toml follows.",
            metavar="[FILE.toml]",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only what `identify` asks before it begins.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder to make for a page with plots, and JSON; none if unset."
        ),
    ] = None,
    fixed_base: FixedBase = None,
    as_json: Json = False,
) -> None:
    """Find out what is wrong with logs, and the lines of the robot file that mend it.

    The exit code is 0 if all is ok, 1 if something is doubtful, 2 if something is wrong; with --fix
    it is that of the new robot file.

    Example: steelyard check ur10e.toml run1.parquet run2.parquet --fix
    """
    from steelyard.cli.show import progress_bar
    from steelyard.estimation.identified import load_model
    from steelyard.identification.check_case import diagnosed, refuse_foreign, subject_of
    from steelyard.identification.fix import fixed, target_of
    from steelyard.identification.logs import log_files, new_folder
    from steelyard.report.check_page import CheckContent

    folder = None if output is None else new_folder(output, "")
    target = None if fix is None else target_of(robot, fix)
    reference = None if model is None else load_model(model)
    files = log_files(logs)
    subject = subject_of(robot, files[0], fixed_base)
    if reference is not None:
        refuse_foreign(reference, subject.loaded, str(model))
    with progress_bar() as progress:
        diagnosis = diagnosed(subject, files, reference, progress, quick=quick)
        mended = None
        if target is not None:
            mended = fixed(subject, target, diagnosis, files, reference, progress, quick=quick)
        content = CheckContent(
            subject.loaded.robot.name,
            robot,
            tuple(file.text for file in files),
            model,
            diagnosis,
            asked(),
            subject.notes,
        )
        told = results(content, mended, folder)
        write(content, told, mended, folder)
    if as_json:
        typer.echo(json.dumps(told, allow_nan=False))
    else:
        show(content, mended, folder)
    last = diagnosis if mended is None else mended.diagnosis
    if last.judgement:
        raise typer.Exit(int(last.judgement))


def write(
    content: "CheckContent",
    told: dict[str, object],
    mended: "Fixed | None",
    folder: Path | None,
) -> None:
    """Write the mended robot file, and the page with its JSON: all of them or none."""
    from steelyard.cli import interrupt
    from steelyard.files import whole_file, whole_folder
    from steelyard.report.check_page import render_check

    with ExitStack() as parts:
        if mended is not None and mended.changes:
            file = parts.enter_context(whole_file(mended.subject.path))
            file.write_text(mended.subject.text, encoding="utf-8")
        if folder is not None:
            part = parts.enter_context(whole_folder(folder))
            (part / "check.html").write_text(render_check(content), encoding="utf-8")
            (part / "check.json").write_text(f"{json.dumps(told, indent=1)}\n", encoding="utf-8")
        interrupt.too_late()


def asked() -> dict[str, str]:
    """The question of every suspicion, by its name."""
    from steelyard.diagnosis.register import SUSPICIONS

    return {suspicion.name: suspicion.asks for suspicion in SUSPICIONS}


def results(
    content: "CheckContent", mended: "Fixed | None", folder: Path | None
) -> dict[str, object]:
    """What `--json` prints, and `check.json` holds."""
    from steelyard.report.text.findings import diagnosis_dict

    return {
        "robot": content.file,
        "logs": list(content.logs),
        "model": content.model,
        **diagnosis_dict(content.diagnosis),
        "notes": list(content.notes),
        "fixed": None if mended is None else mended.to_dict(),
        "output": None if folder is None else str(folder),
    }


def show(content: "CheckContent", mended: "Fixed | None", folder: Path | None) -> None:
    """Print what was found, what was changed, and where it is written."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    from steelyard.report.terminal.findings import show as show_findings

    console = Console()
    for note in content.notes:
        console.print(Text(f"note: {note}", style="dim"))
    if content.notes:
        console.print()
    show_findings(content.diagnosis, console)
    if mended is not None:
        console.print()
        if not mended.changes:
            console.print(Text("No robot file is written" + (":" if mended.reasons else ".")))
            for reason in mended.reasons:
                console.print(Text(f"  {reason}"), soft_wrap=True)
        else:
            console.print(Text(f"{mended.subject.path} says otherwise:", style="bold"))
            for change in mended.changes:
                console.print(Text(f"  {change.line}", style="cyan"), soft_wrap=True)
                console.print(Padding(Text(change.cause, style="dim"), (0, 0, 0, 4)))
            console.print()
            console.print(Text(f"Checked again with {mended.subject.path}:", style="bold"))
            console.print()
            show_findings(mended.diagnosis, console, fine=False)
    for line in hints(content, mended, folder):
        console.print(Text(line), soft_wrap=True)


def hints(content: "CheckContent", mended: "Fixed | None", folder: Path | None) -> list[str]:
    """Where things are written, or how to have them written."""
    lines = [""]
    if mended is not None and mended.changes:
        lines.append(f"robot file  {mended.subject.path}")
    if folder is not None:
        lines += [f"page        {folder / 'check.html'}", f"JSON        {folder / 'check.json'}"]
    if mended is None and content.diagnosis.edits:
        lines.append("--fix       writes a new robot file with these lines, and checks again")
    if folder is None and content.diagnosis.judgement:
        lines.append("-o FOLDER   writes a page with the plots")
    return lines if len(lines) > 1 else []

"""`steelyard init`: a commented robot file with the best guesses."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import ARGUMENTS, FixedBase, Json

if TYPE_CHECKING:
    from steelyard.robot_file.template.template import Draft

INCOMPLETE = 1
"""Exit code where the robot file is written, but has to be completed before it is of use."""

_NAMED = 6
"""Joints of hands that are named; the robot file lists all."""


@guarded
def init(
    model: Annotated[
        str,
        typer.Argument(help=f"URDF, xacro file or MJCF of the robot. {ARGUMENTS}", metavar="URDF"),
    ],
    log: Annotated[Path | None, typer.Argument(help="Log from which columns are guessed.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Robot file to write; must not exist.")
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            help="Sampling rate of the log in Hz, if it has no time column.", min=1e-6, max=1e6
        ),
    ] = None,
    fixed_base: FixedBase = None,
    as_json: Json = False,
) -> None:
    """Write a commented robot file: guesses columns, locks finger joints, copies limits.

    The exit code is 1 if columns of some joints are missing in the log or not recognised.

    Example: steelyard init panda.urdf run1.csv -o panda.toml

    Without a time column: steelyard init panda.urdf run1.csv --rate 1000
    """
    from steelyard.cli import interrupt
    from steelyard.errors import ModelError, OutputError
    from steelyard.files import whole_file
    from steelyard.identification.logs import sample_of
    from steelyard.robot_file.file import load_robot
    from steelyard.robot_file.template.proposal import proposed
    from steelyard.robot_file.template.template import drafted, notes_beside

    proposal = proposed(model, fixed_base)
    target = output if output is not None else Path(f"{proposal.loaded.stem}.toml")
    if target.exists():
        raise OutputError(
            "the robot file exists already",
            where=str(target),
            fix="name another one with --output, or remove it",
        )
    if rate is not None and log is None:
        raise ModelError(
            "--rate is given without a log",
            where="--rate",
            fix="give the log after the model file, or leave out --rate",
        )
    columns, sample = (None, None) if log is None else sample_of(log)
    draft = drafted(proposal, columns, sample, target, rate)
    with whole_file(target) as part:
        part.write_text(draft.text, encoding="utf-8")
        interrupt.too_late()
    notes = (*proposal.notes, *_hands(draft), *notes_beside(proposal.loaded, load_robot(target)))
    if as_json:
        typer.echo(json.dumps(results(draft, target, notes)))
    else:
        show(draft, target, notes)
    if draft.problem or draft.without_columns:
        raise typer.Exit(INCOMPLETE)


def results(draft: "Draft", target: Path, notes: Sequence[str]) -> dict[str, object]:
    """What `--json` prints."""
    return {
        "robot_file": str(target),
        "joints": list(draft.identified),
        "without_columns": list(draft.without_columns),
        "columns_found": draft.guess is not None,
        "problem": draft.problem or None,
        "guesses": [] if draft.guess is None else list(draft.guess.reasons),
        "notes": list(notes),
    }


def _hands(draft: "Draft") -> tuple[str, ...]:
    """That joints of hands are locked, if so."""
    if not draft.hands:
        return ()
    shown = ", ".join(draft.hands[:_NAMED])
    more = f" and {len(draft.hands) - _NAMED} more" if len(draft.hands) > _NAMED else ""
    return (
        f"locked {shown}{more} (recognised as joints of a hand); to identify one, move it from "
        "[robot.locked] to joints",
    )


def show(draft: "Draft", target: Path, notes: Sequence[str]) -> None:
    """Print what is written, what was guessed, and what is left to fill in."""
    from rich.console import Console
    from rich.text import Text

    from steelyard.report.text.words import count

    console = Console()

    def say(words: str, style: str = "") -> None:
        console.print(Text(words, style=style), soft_wrap=True)

    say(f"wrote {target}: {count(len(draft.identified), 'joint')} to identify")
    for reason in () if draft.guess is None else draft.guess.reasons:
        say(f"guess {reason}")
    for note in notes:
        say(f"note  {note}")
    if draft.without_columns:
        names = ", ".join(draft.without_columns)
        say(f"NOT FOUND: columns of {names}; the robot file locks these joints at zero", "bold red")
    if draft.guess is None:
        why = f"NOT FOUND: columns of the log: {draft.problem}" if draft.problem else "no log given"
        say(why, "bold red" if draft.problem else "")
    if draft.guess is None and not draft.problem:
        say("next  review the lines marked CHECK, then design a motion to record:")
        say(f"      steelyard excite {target} -o motion")
        say("      with its log (columns are guessed unless [signals] names them):")
    elif draft.guess is None:
        say(f"next  fill in [signals], which is commented out in {target}; then:")
    else:
        say("next  review the lines marked CHECK, then:")
    say(f"      steelyard check {target} LOG...")
    say(f"      if no error is found:  steelyard identify {target} LOG...")

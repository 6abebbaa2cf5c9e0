"""`steelyard init`: a commented robot file with the best guesses."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json


@guarded
def init(
    model: Annotated[Path, typer.Argument(help="URDF or MJCF of the robot.", metavar="URDF")],
    log: Annotated[
        Path | None, typer.Argument(help="A log of the robot, to guess its columns from.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Robot file to write; must not exist.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a commented robot file: columns guessed, fingers locked, limits taken over.

    Example: steelyard init panda.urdf run1.parquet -o panda.toml
    """
    from steelyard.cli import interrupt, river
    from steelyard.errors import OutputError
    from steelyard.files import whole_file
    from steelyard.robot.init_file import robot_file_text
    from steelyard.robot.robot_file import load_robot

    loaded = load_robot(model)
    target = output if output is not None else Path(f"{model.stem}.toml")
    if target.exists():
        raise OutputError(
            "the robot file exists already",
            where=str(target),
            mend="name another one with --output, or remove it",
        )
    columns, sample = (None, None) if log is None else river.sample_of(log)
    text = robot_file_text(model, loaded, columns, sample, target)
    with whole_file(target) as part:
        part.write_text(text, encoding="utf-8")
        interrupt.too_late()
    written = load_robot(target)
    if as_json:
        facts = {
            "robot_file": str(target),
            "joints": list(written.robot.joint_names),
            "notes": [*loaded.notes, *written.notes],
        }
        typer.echo(json.dumps(facts))
        return
    typer.echo(f"wrote {target}: {written.robot.n} joints identified")
    for note in dict.fromkeys((*loaded.notes, *written.notes)):
        typer.echo(f"note  {note}")
    typer.echo(
        f"next  read it, mend it, then: steelyard check {target} LOG...\n"
        f"      and if all is well:     steelyard identify {target} LOG..."
    )

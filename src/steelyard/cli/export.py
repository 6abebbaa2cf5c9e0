"""`steelyard export`: an identified model as URDF or MJCF."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json

if TYPE_CHECKING:
    from steelyard.application.export.content import Format
    from steelyard.application.export.export import Exported

ENDINGS: "dict[str, Format]" = {".urdf": "urdf", ".mjcf": "mjcf", ".xml": "mjcf"}
FEW = 0.5
"""Share of a link's mass from the data below which the terminal names the link."""

USUAL: "dict[Format, str]" = {"urdf": ".urdf", "mjcf": ".xml"}


@guarded
def export(
    model: Annotated[
        str, typer.Argument(help="model.json, or the folder that contains it.", metavar="MODEL")
    ],
    to: Annotated[
        Literal["urdf", "mjcf"] | None,
        typer.Option(help="Format; if unset, from the suffix of --output."),
    ] = None,
    original: Annotated[
        Path | None,
        typer.Option(
            "--model",
            help="URDF of the robot, or its robot file: values are written into a copy; meshes "
            "and comments are kept.",
            metavar="URDF",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Output file; must not exist. If unset, in the current folder and named after "
            "the robot.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the masses, inertias and friction of an identified model as URDF or MJCF.

    Terminal and file header list what the format cannot represent, and what comes from the prior
    instead of the data.

    Example: steelyard export steelyard-ur10e --to mjcf -o ur10e.xml
    """
    from steelyard.application.export.export import exported, refuse_changed
    from steelyard.cli import interrupt
    from steelyard.estimation.identified import load_model
    from steelyard.files import whole_file

    form = _format(to, output)
    identified = load_model(model)
    path = _new_file(output, f"{identified.model.robot.name}{USUAL[form]}")
    made = exported(identified, form, original)
    with whole_file(path) as part:
        part.write_text(made.text, encoding="utf-8", newline="")
        refuse_changed(part, made)
        interrupt.too_late()
    if as_json:
        told = {
            "file": str(path),
            "format": form,
            "unheld": list(made.unsupported),
            "mass_from_data": made.mass_shares,
            "not_seen": list(made.unseen),
            "impossible_in_original": list(made.impossible),
        }
        typer.echo(json.dumps(told))
        return
    _tell(path, made)


def _format(to: "Format | None", output: Path | None) -> "Format":
    """The format that is asked for, by name or by the file's ending.

    Raises:
        OutputError: Neither says it, or they say two things.
    """
    from steelyard.errors import OutputError

    ending = "" if output is None else output.suffix.lower()
    form = to or ENDINGS.get(ending)
    if form is None:
        raise OutputError(
            "no format is named",
            where="--to" if output is None else str(output),
            fix="give --to urdf or --to mjcf, or end the name of --output in .urdf or .xml",
        )
    if ending in (".urdf", ".mjcf") and ENDINGS[ending] != form:
        raise OutputError(
            f"the file would be {form.upper()}, but its name ends in '{ending}'",
            where=str(output),
            fix=f"end its name in '{USUAL[form]}', or give --to {ENDINGS[ending]}",
        )
    return form


def _new_file(output: Path | None, default: str) -> Path:
    """The file to make.

    Raises:
        OutputError: It is there already.
    """
    from steelyard.errors import OutputError

    path = Path(default.replace("/", "_")).absolute() if output is None else output
    if path.exists():
        raise OutputError(
            "the file exists already",
            where=str(path),
            fix="name another one with --output, or remove it",
        )
    return path


def _tell(path: Path, made: "Exported") -> None:
    """What was written, and what was not."""
    from rich.console import Console
    from rich.text import Text

    from steelyard.application.export.export import KEPT, UNSEEN, listed_under

    content = made.content
    count = sum(not body.massless for body in content.robot.bodies)
    mass = sum(inertia.mass for inertia in content.inertias)
    console = Console()
    links = "1 moving link" if count == 1 else f"{count} moving links"
    console.print(Text(f"{path}: {links}, {mass:.4g} kg"), soft_wrap=True)
    few = [f"{name} {x:.0%}" for name, x in made.mass_shares.items() if x < FEW]
    for heading, sentences in (
        (f"{made.form.upper()} cannot represent:", made.unsupported),
        (
            "mostly from the prior (share of the mass that comes from the data):",
            (", ".join(few),) if few else (),
        ),
        (UNSEEN, (", ".join(made.unseen),) if made.unseen else ()),
        (KEPT, made.impossible),
    ):
        for line in listed_under(heading, sentences):
            console.print(Text(line))

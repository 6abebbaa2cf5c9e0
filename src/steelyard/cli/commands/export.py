"""`steelyard export`: an identified model as URDF, MJCF or code for controllers."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json, ModelArgument

if TYPE_CHECKING:
    from steelyard.application.controller.export import Written
    from steelyard.application.export.export import Exported

Kind = Literal["urdf", "mjcf", "c", "python", "fmu", "ros2", "simulink"]
ENDINGS: dict[str, Kind] = {
    ".urdf": "urdf",
    ".mjcf": "mjcf",
    ".xml": "mjcf",
    ".py": "python",
    ".fmu": "fmu",
}
NAMES: dict[Kind, str] = {
    "urdf": "URDF",
    "mjcf": "MJCF",
    "c": "C",
    "python": "Python",
    "fmu": "an FMU",
    "ros2": "a ROS 2 package",
    "simulink": "Simulink",
}
FEW = 0.5
"""Share of a link's mass from the data below which the terminal names the link."""

USUAL: dict[Kind, str] = {
    "urdf": ".urdf",
    "mjcf": ".xml",
    "c": "-c",
    "python": ".py",
    "fmu": ".fmu",
    "ros2": "-ros2",
    "simulink": "-simulink",
}


@guarded
def export(
    model: ModelArgument,
    to: Annotated[
        Kind | None,
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
            help="Output file, of C, ROS 2 and Simulink a folder; must not exist. If unset, in the "
            "current folder and named after the robot.",
        ),
    ] = None,
    precision: Annotated[
        Literal["double", "float"] | None,
        typer.Option(help="Type of numbers in C; double if unset."),
    ] = None,
    functions: Annotated[
        list[str] | None,
        typer.Option(
            "--function",
            help="Function in the C or Python code; repeat for several: torque, gravity, bias, "
            "friction, mass, regressor (all of these if unset), momentum, momentum_rate, "
            "forward_dynamics, observer (external efforts and contact).",
            metavar="NAME",
        ),
    ] = None,
    frames: Annotated[
        list[str] | None,
        typer.Option(
            "--frame",
            help="Frame whose pose and Jacobian are in the C or Python code; repeat for several; "
            "if unset, those at the robot's ends.",
            metavar="NAME",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write an identified model as URDF or MJCF, or as code for controllers.

    Code is C, Python, an FMU, a ROS 2 package or an S-function for Simulink.

    Of URDF and MJCF, terminal and file header list what the format cannot represent, and what
    comes from the prior instead of the data.

    Example: steelyard export steelyard-ur10e --to c -o ur10e-c
    """
    from steelyard.application.export.export import exported, refuse_changed
    from steelyard.cli import interrupt
    from steelyard.estimation.identified import load_model
    from steelyard.files import whole_file

    form = _format(to, output)
    identified = load_model(model)
    path = _new_file(output, f"{identified.model.robot.name}{USUAL[form]}")
    if form != "urdf" and form != "mjcf":
        _refuse(form, {"--model": original})
        from steelyard.application.controller.export import write_code

        written = write_code(
            identified, path, form, precision or "double", functions or (), frames or ()
        )
        _print_code(path, form, written, as_json)
        return
    _refuse(form, {"--precision": precision, "--function": functions, "--frame": frames})
    made = exported(identified, form, original)
    with whole_file(path) as part:
        part.write_text(made.text, encoding="utf-8", newline="")
        refuse_changed(part, made)
        interrupt.too_late()
    if as_json:
        printed = {
            "file": str(path),
            "format": form,
            "unsupported": list(made.unsupported),
            "mass_from_data": made.mass_shares,
            "not_seen": list(made.unseen),
            "impossible_in_original": list(made.impossible),
        }
        typer.echo(json.dumps(printed))
        return
    _print_export(path, made)


def _format(to: Kind | None, output: Path | None) -> Kind:
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
            fix="give --to urdf, mjcf, c, python, fmu, ros2 or simulink, or end the name of "
            "--output in .urdf, .xml, .py or .fmu",
        )
    if ending in (".urdf", ".mjcf", ".py", ".fmu") and ENDINGS[ending] != form:
        usual = USUAL[form]
        name = f"end its name in '{usual}'" if usual.startswith(".") else "name a folder"
        raise OutputError(
            f"the file would be {NAMES[form]}, but its name ends in '{ending}'",
            where=str(output),
            fix=f"{name}, or give --to {ENDINGS[ending]}",
        )
    return form


def _refuse(form: Kind, given: dict[str, object]) -> None:
    """Refuse options that a format has no use for.

    Raises:
        OutputError: One of them is given.
    """
    from steelyard.errors import OutputError

    for option, value in given.items():
        if value:
            raise OutputError(
                f"{option} does not apply to {NAMES[form]}",
                where=option,
                fix=f"leave it out, or give --to {'urdf' if option == '--model' else 'c'}",
            )


def _new_file(output: Path | None, default: str) -> Path:
    """The file to make.

    Raises:
        OutputError: It is there already.
    """
    from steelyard.files import refuse_existing

    path = Path(default.replace("/", "_")).absolute() if output is None else output
    refuse_existing(path)
    return path


def _print_export(path: Path, made: "Exported") -> None:
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


def _print_code(path: Path, form: Kind, written: "Written", as_json: bool) -> None:
    """What was written, names that became others, and functions that there cannot be."""
    from rich.console import Console
    from rich.text import Text

    if as_json:
        printed = {
            "file": str(path),
            "format": form,
            "files": list(written.files),
            "functions": list(written.functions),
            "absent": list(written.absent),
            "identifiers": written.renamed,
            "stack_bytes": written.stack,
        }
        typer.echo(json.dumps(printed))
        return
    lines = [f"{path}: {', '.join(written.files)}", f"functions: {', '.join(written.functions)}"]
    if written.stack is not None:
        lines.append(f"local variables: at most {written.stack} bytes a function")
    if written.absent:
        lines.append(
            f"without {', '.join(written.absent)}: friction with memory needs the state of start "
            'and step; a model of friction = "auto_memoryless" in the robot file has all'
        )
    if written.renamed:
        pairs = ", ".join(f"{name} as {plain}" for name, plain in written.renamed.items())
        lines.append(f"identifiers: {pairs}")
    for line in lines:
        Console().print(Text(line), soft_wrap=True)

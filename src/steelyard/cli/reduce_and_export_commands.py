"""The commands `reduce` and `export`: another form of an identified model."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from steelyard.base.errors import ModelError, OutputError
from steelyard.base.files import new_folder, refuse_existing, whole_file, whole_folder
from steelyard.base.progress import DESIGN_BUDGET_S
from steelyard.cli import interrupt
from steelyard.cli import shared_by_commands as shared
from steelyard.cli.commands_from_functions import from_function
from steelyard.report.words import count, significant

if TYPE_CHECKING:
    from steelyard.export.code.export_code import WrittenCode
    from steelyard.export.model_files.export_model_file import Exported
    from steelyard.identify.reduce import ReducedModel


@from_function(
    "steelyard:reduce",
    criterion={"metavar": "NAME"},
    stop={"metavar": "RULE"},
    robot={"metavar": "ROBOT"},
    following={"name": "--next", "metavar": "DIR"},
    last={"metavar": "MOTION"},
    limit={"min": 1.0, "metavar": "NUMBER"},
    budget={"min": 1.0},
)
def reduce(
    call: "partial[ReducedModel]",
    robot: str | None = None,
    bodies: bool = False,
    following: Path | None = None,
    last: Path | None = None,
    limit: float | None = None,
    budget: float = DESIGN_BUDGET_S,
    output: Annotated[Path | None, shared.output_folder("steelyard-reduced")] = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Remove parameters as long as errors on left-out data do not rise significantly.

    Removed parameters are zero, and the others are estimated again. The smaller model describes
    the speeds and postures of the logs; elsewhere a removed parameter may matter. The estimate with
    a prior (`steelyard identify`) often predicts as well without removing anything.

    Options:
        robot: Robot file; --bodies and --next need it.
        bodies: Estimate physically consistent link inertial parameters, with the removed
            parameters equal to zero; such a model can be exported.
        following: Also design the motion that excites the smaller model best, into this folder.
        last: trajectory.json of the motion that was logged: the next one is improved from it.
        limit: Condition number of the next motion's observation matrix, not normalised, at which
            the reduction is finished; the last lines and --json say whether it is reached. The
            motion is then designed for this condition number, whatever the robot file says.
        budget: Time limit of that design in seconds.

    Example: steelyard reduce steelyard-ur10e run1.parquet run2.parquet --validate run3.parquet

    Example: steelyard reduce steelyard-leg run*.csv --criterion contribution --each
    """
    from steelyard.base.arrays import finite_json
    from steelyard.excite.excite import design_excitation, design_task
    from steelyard.identify.verdict_and_next_steps import exit_code

    _refuse_missing(robot, {"--bodies": bodies, "--next": following is not None})
    if following is None:
        needless = {"--last": last, "--limit": limit}
        shared.refuse_options(
            needless, "is given, but no motion is designed", "add --next DIR, or leave it out"
        )
    folder = new_folder(output, "steelyard-reduced")
    motion_folder = shared.optional_folder(following)
    criterion: str | None = None if limit is None else "condition"
    if motion_folder is not None and robot is not None:
        _refuse_same(folder, motion_folder)
        design_task(robot, earlier=call.keywords["model"], start=last, criterion=criterion)
    with shared.progress_bar() as progress:
        found = call(bodies=robot if bodies else None, progress=progress)
        with whole_folder(folder) as place:
            found.write(place)
            if motion_folder is None:
                interrupt.too_late()
    interrupt.finished(str(folder))
    if not as_json:
        shared.show(found, verbose)
        typer.echo("\n" + shared.file_lines(folder, model="model.json", report="report.html"))
    designed: dict[str, object] | None = None
    if motion_folder is not None and robot is not None:
        with shared.progress_bar() as progress, whole_folder(motion_folder) as place:
            design = partial(design_excitation, start=last, criterion=criterion, budget=budget)
            motion = design(robot, earlier=found.model, progress=progress)
            motion.write(place)
            interrupt.too_late()
        condition = motion.designed.shown.raw
        finished = None if limit is None else bool(condition <= limit)
        designed = {"condition": finite_json(condition), "limit": limit, "finished": finished}
        if not as_json:
            shared.say("\n".join(_next_lines(condition, limit)))
            typer.echo(shared.file_lines(motion_folder, motion="trajectory.json"))
    if as_json:
        written = {"output": str(folder), "motion": motion_folder and str(motion_folder)}
        shared.print_json({**found.to_dict(), **written, "next": designed})
    raise typer.Exit(exit_code(found.content))


def _next_lines(condition: float, limit: float | None) -> list[str]:
    lines = [f"condition number of the next motion (not normalised): {significant(condition, 4)}"]
    if limit is not None and condition <= limit:
        lines.append(
            f"at most {limit:g}: the reduction is finished; for the final estimate run this motion "
            "and estimate from its log with --stop refit"
        )
    elif limit is not None:
        lines.append(
            f"above {limit:g}: run this motion and reduce further from its log with "
            "--stop one_fewer"
        )
    return lines


def _refuse_missing(robot: str | None, asking: dict[str, bool]) -> None:
    if robot is None and any(asking.values()):
        raise ModelError(
            f"{' and '.join(name for name, given in asking.items() if given)} without a robot file",
            where="--robot",
            fix="give the robot file that the model was identified with: --robot ROBOT",
        )


def _refuse_same(folder: Path, motion_folder: Path) -> None:
    """Refuse to write a motion to where the model, or a folder around it, is written before."""
    if motion_folder.resolve() in (folder.resolve(), *folder.resolve().parents):
        wrong = f"the motion's folder is that of the reduced model ({folder}), or contains it"
        fix = "name another folder, outside of which the model is written"
        raise OutputError(wrong, where=f"--next {motion_folder}", fix=fix)


Kind = Literal["urdf", "mjcf", "c", "python", "fmu", "ros2", "simulink", "usd", "isaaclab", "mjlab"]
FORMATS: dict[Kind, tuple[str, str]] = {
    "urdf": ("URDF", ".urdf"),
    "mjcf": ("MJCF", ".xml"),
    "c": ("C", "-c"),
    "python": ("Python", ".py"),
    "fmu": ("an FMU", ".fmu"),
    "ros2": ("a ROS 2 package", "-ros2"),
    "simulink": ("Simulink", "-simulink"),
    "usd": ("USD", ".usda"),
    "isaaclab": ("a configuration of Isaac Lab", "_isaaclab.py"),
    "mjlab": ("a configuration of mjlab", "_mjlab.py"),
}
"""What is written, in words, and the usual ending of its name."""

ENDINGS = {".mjcf": "mjcf", ".usd": "usd"} | {
    end: kind for kind, (_, end) in FORMATS.items() if end[0] == "."
}
FEW_DATA_SHARE = 0.5  # share of a link's mass from the data below which the terminal names the link


@from_function(
    original={"name": "--model", "metavar": "URDF"},
    functions={"name": "--function", "metavar": "NAME"},
    frames={"name": "--frame", "metavar": "NAME"},
    units={"name": "--unit", "metavar": "MODEL"},
)
def export(
    model: str,
    to: Kind | None = None,
    original: Path | None = None,
    output: Path | None = None,
    precision: Literal["double", "float"] | None = None,
    functions: list[str] | None = None,
    frames: list[str] | None = None,
    units: list[str] | None = None,
    as_json: bool = False,
) -> None:
    """Write an identified model as URDF or MJCF, or as code for controllers.

    Options:
        to: Format; if unset, from the suffix of --output.
        original: URDF of the robot, or its robot file: values are written into a copy; meshes and
            comments are kept.
        output: Output file, of C, ROS 2 and Simulink a folder; must not exist. If unset, in the
            current folder and named after the robot.
        precision: Type of numbers in C; double if unset.
        functions: Function in the C or Python code; repeat for several: torque, gravity, bias,
            friction, mass, regressor (all of these if unset), momentum, momentum_rate,
            forward_dynamics, observer (external efforts and contact).
        frames: Frame whose pose and Jacobian are in the C or Python code; repeat for several; if
            unset, those at the robot's ends.
        units: Model of the actuators of another robot of the kind; repeat for several: the file
            says in which range 95 % of such robots have each value.

    Code is C, Python, an FMU, a ROS 2 package or an S-function for Simulink.

    Identified actuators are written as MJCF with position actuators, as USD with Newton's schemas,
    or as configurations of Isaac Lab (isaaclab) or mjlab.

    Of URDF and MJCF, terminal and file header list what the format cannot represent, and what
    comes from the prior instead of the data.

    Example: steelyard export steelyard-ur10e --to c -o ur10e-c
    """
    from steelyard.actuators.actuator_model import is_actuator_model
    from steelyard.cli.actuator_commands import actuators_exported
    from steelyard.estimate.identified_model import load_model
    from steelyard.export.model_files.export_model_file import exported, refuse_changed

    form = _format(to, output)
    if is_actuator_model(model):
        options: dict[str, object] = {"--model": original, "--precision": precision}
        options |= {"--function": functions, "--frame": frames}
        shared.refuse_options(options, "does not apply to a model of actuators", "leave it out")
        return actuators_exported(model, form, output, units or (), as_json)
    shared.refuse_options(
        {"--unit": units}, "is for models of actuators, and this one has none", "leave it out"
    )
    identified = load_model(model)
    if form == "usd" or form == "isaaclab" or form == "mjlab":
        raise OutputError(
            f"{form} is for models of actuators, and this one is identified from efforts",
            where="--to",
            fix="give --to mjcf or urdf; or identify from logs of targets without efforts",
        )
    usual = f"{identified.model.robot.name}{FORMATS[form][1]}".replace("/", "_")
    path = Path(usual).absolute() if output is None else output
    refuse_existing(path)
    needless = f"does not apply to {FORMATS[form][0]}"
    if form != "urdf" and form != "mjcf":
        shared.refuse_options({"--model": original}, needless, "leave it out, or give --to urdf")
        from steelyard.export.code.export_code import write_code

        written = write_code(
            identified, path, form, precision or "double", functions or (), frames or ()
        )
        _print_code(path, form, written, as_json)
        return
    of_code = {"--precision": precision, "--function": functions, "--frame": frames}
    shared.refuse_options(of_code, needless, "leave it out, or give --to c")
    made = exported(identified, form, original)
    with whole_file(path) as part:
        part.write_text(made.text, encoding="utf-8", newline="")
        refuse_changed(part, made)
        interrupt.too_late()
    _print_export(path, made, as_json)


def _format(to: Kind | None, output: Path | None) -> Kind:
    """The format that is requested, by name or by the file's ending, which must agree."""
    ending = "" if output is None else output.suffix.lower()
    of_ending = cast("Kind | None", ENDINGS.get(ending))
    form = to or of_ending
    if form is None:
        raise OutputError(
            "no format is named",
            where="--to" if output is None else str(output),
            fix=f"give --to {', '.join(FORMATS)}, or end the name of --output in .urdf, .xml, "
            ".py, .fmu or .usda",
        )
    if form == "usd" and output is not None and ending not in (".usda", ".usd"):
        raise OutputError(
            f"USD is written as text, and the name ends in '{ending}'",
            where=str(output),
            fix="end it in .usda or .usd",
        )
    means = "python" if form in ("isaaclab", "mjlab") else form  # they are Python too
    if of_ending not in (None, means) and (ending != ".xml" or means == "python"):
        what, usual = FORMATS[form]
        name = f"end its name in '{usual}'" if "." in usual else "name a folder"
        wrong = f"the file would be {what}, but its name ends in '{ending}'"
        fix = f"{name}, or give --to {of_ending}"
        raise OutputError(wrong, where=str(output), fix=fix)
    return form


def _print_export(path: Path, made: "Exported", as_json: bool) -> None:
    from steelyard.export.model_files import export_model_file as model_files

    if as_json:
        shared.print_json(
            {
                "file": str(path),
                "format": made.form,
                "unsupported": list(made.unsupported),
                "mass_from_data": made.mass_shares,
                "not_seen": list(made.unseen),
                "impossible_in_original": list(made.impossible),
                "implausibly_light": list(made.light),
            }
        )
        return
    links = count(sum(not body.massless for body in made.content.robot.bodies), "moving link")
    mass = sum(inertia.mass for inertia in made.content.inertias)
    shared.say(f"{path}: {links}, {mass:.4g} kg")
    few = [f"{name} {x:.0%}" for name, x in made.mass_shares.items() if x < FEW_DATA_SHARE]
    for heading, sentences in (
        (f"{made.form.upper()} cannot represent:", made.unsupported),
        (
            "mostly from the prior (share of the mass that comes from the data):",
            (", ".join(few),) if few else (),
        ),
        (model_files.UNSEEN, (", ".join(made.unseen),) if made.unseen else ()),
        (model_files.LIGHT_LINKS, made.light),
        (model_files.KEPT, made.impossible),
    ):
        shared.print_lines(*model_files.listed_under(heading, sentences))


def _print_code(path: Path, form: Kind, written: "WrittenCode", as_json: bool) -> None:
    if as_json:
        shared.print_json(
            {
                "file": str(path),
                "format": form,
                "files": list(written.files),
                "functions": list(written.functions),
                "absent": list(written.absent),
                "identifiers": written.renamed,
                "stack_bytes": written.stack,
            }
        )
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
    shared.print_lines(*lines, whole=True)

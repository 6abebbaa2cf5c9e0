"""The commands `identify`, `validate` and `compare`, and those that use an identified model."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.base.errors import DataError
from steelyard.base.files import refuse_existing, whole_folder, write_json
from steelyard.base.progress import Progress
from steelyard.cli import interrupt
from steelyard.cli import shared_by_commands as shared
from steelyard.cli.commands_from_functions import from_function
from steelyard.report.words import significant

if TYPE_CHECKING:
    from steelyard.estimate.payload.payload_estimate import PayloadEstimate
    from steelyard.identify.comparison.compare import EstimatorComparison
    from steelyard.identify.identify import Identification
    from steelyard.identify.validate import Validation
    from steelyard.report.result import Result
    from steelyard.uses.control.feedforward import FeedforwardTorques
    from steelyard.uses.health.health import Health

NO_CHECK = {"help": "Skip the check of the logs; see `steelyard check`."}


@from_function("steelyard:identify", check=NO_CHECK, bootstrap={"metavar": "N"})
def identify(
    call: "partial[Identification]",
    output: Annotated[Path | None, shared.output_folder("steelyard-ROBOT")] = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Identify a robot's dynamics from logs of its motion.

    Of a robot file with position targets and no efforts, or a section "actuator", the actuators are
    identified: stiffness, damping, friction and rotor inertia of every joint.

    The exit code is 1 if the verdict is poor, by the model or by a log of --validate: the model is
    written, but should not be used before the headline's reason is corrected.

    Example: steelyard identify ur10e.toml run1.csv run2.csv --validate run3.csv
    """
    from steelyard.cli.actuator_commands import actuators_identified, follows_targets
    from steelyard.identify.verdict_and_next_steps import exit_code, next_steps, step_lines

    robot = call.keywords["robot"]
    folder = shared.robot_folder(output, robot)
    if follows_targets(robot):
        return actuators_identified(call.keywords, folder, verbose, as_json)
    found = shared.computed(call, folder)
    if as_json:
        shared.print_json({"output": str(folder), **found.to_dict()})
    else:
        shared.show(found, verbose)
        lines = step_lines(next_steps(found.content, robot, folder))
        paths = shared.file_lines(folder, model="model.json", report="report.html")
        typer.echo("\n".join(["", *lines, paths]))
    raise typer.Exit(exit_code(found.content))


@from_function("steelyard:validate", max_error={"min": 0.0, "metavar": "PERCENT"})
def validate(
    call: "partial[Validation]",
    output: shared.ReportFolder = None,
    max_error: float | None = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Score an identified model on logs that it was not fitted to.

    Of identified actuators: how far positions are from those that the targets alone predict.

    Options:
        max_error: Largest error, in % of the effort used, or of the error of "position = target";
            above it the exit code is 1.

    Exit code 0: done, and the error is not too large. 1: the verdict is poor (the headline's error
    is above 30 %, of actuators 80 % of the error of "position = target", or something is wrong
    with these logs), or with --max-error: that error is above it, or no log has unseen motion. 2:
    not done.

    Example: steelyard validate steelyard-ur10e other_motion.csv
    """
    from steelyard.actuators.actuator_model import is_actuator_model
    from steelyard.cli.actuator_commands import actuators_validated
    from steelyard.identify import verdict_and_next_steps as judging

    folder, model = shared.optional_folder(output), call.keywords["model"]
    if is_actuator_model(model):
        return actuators_validated(call.keywords, folder, max_error, verbose, as_json)
    found = shared.computed(call, folder)
    if as_json:
        shared.print_json(found.to_dict()["logs"])
    else:
        shared.show(found, verbose)
        steps = [*judging.fix_commands(found.content, model, judging.robot_file(found.content))]
        if not found.content.scores:
            command = f"steelyard validate {judging.path_word(model)} OTHER_LOG"
            steps.append((command, "error on another motion"))
        lines = judging.step_lines(tuple(steps))
        if folder is not None:
            lines.append(shared.file_lines(folder, report="report.html"))
        if lines:
            typer.echo("\n".join(["", *lines]))
    above = judging.error_limit_words(found.verdict, max_error)
    if above and not as_json:
        typer.echo(f"\n{above}")
    raise typer.Exit(max(judging.exit_code(found.content), int(bool(above))))


@from_function(
    "steelyard:compare",
    estimators={"metavar": "NAME..."},
    everything={"name": "--all"},
    check=NO_CHECK,
    interruption=None,
)
def compare(
    call: "partial[EstimatorComparison]",
    output: shared.PlotsFolder = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Compare estimators by cross-validation: fit all logs but one and predict it.

    Ctrl-C ends the comparison; finished estimators are reported.

    Example: steelyard compare ur10e.toml run1.csv run2.csv run3.csv -o compared
    """

    def compute(progress: Progress) -> "EstimatorComparison":
        found = call(progress=progress, interruption=interrupt.Interrupted)
        if found.untried:
            interrupt.answered()
        return found

    files = {"page": "compare.html", "JSON": "compare.json"}
    found = shared.reported(compute, output, as_json, verbose, **files)
    if found.untried:
        raise typer.Exit(interrupt.INTERRUPTED)


@from_function(
    "steelyard:compare_models",
    models={
        "help": "Two or more models: model.json, or the folders that contain it.",
        "metavar": "MODEL...",
    },
    logs={
        "name": "--on",
        "help": f"{shared.LOG_HELP} Not logs that a model was identified from.",
        "metavar": "LOG...",
    },
)
def compare_models(
    call: "partial[Result]",
    output: shared.PlotsFolder = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Compare identified models of one robot on logs: errors, parameters, masses, efforts.

    Logs are processed as for the first model, so that all models predict the same effort.

    Example: steelyard compare-models full-model reduced-model --on other_motion.csv -o compared
    """
    shared.reported(call, output, as_json, verbose, page="models.html", JSON="models.json")


XYZ = {"type": tuple[float, float, float] | None, "metavar": "X Y Z"}


@from_function(
    "steelyard:identify_payload",
    logs={"help": f"With the payload. {shared.LOG_HELP}"},
    gain_uncertainty={"max": 0.5, "metavar": "SHARE"},
    mass={"min": 1e-6},
    com=XYZ,
    box=XYZ,
    cylinder={"type": tuple[float, float] | None, "metavar": "D L"},
    sphere={"metavar": "D"},
)
def payload(
    call: "partial[PayloadEstimate]",
    when: bool = False,
    output: Path | None = None,
    as_json: bool = False,
) -> None:
    """Identify a payload: physically consistent mass, centre and inertia, with 95 % intervals.

    With --when: times at which it is picked up and put down, each with a 95 % interval.

    Options:
        when: Find when something is picked up and put down along each log.
        output: Output folder for payload.json and, with --when, a page.

    Example: steelyard payload steelyard-ur10e loaded.csv --frame tool0 --box 0.2 0.1 0.1
    """
    from steelyard.report.terminal import terminal
    from steelyard.uses.payload.payload import events_of_logs, payload_lines

    given = call.keywords
    common = ("model", "logs", "frame", "gain_uncertainty")
    if when and any(value for name, value in given.items() if name not in common):
        raise DataError(
            "events are found with the model alone",
            where="--unloaded" if given.get("unloaded") else "--mass, --com, --box, ...",
            fix="leave these out with --when, or weigh without --when",
        )
    if when:
        events = partial(events_of_logs, *(given[name] for name in common))
        shared.reported(events, output, as_json, payload="payload.json", report="report.html")
        return
    folder = shared.optional_folder(output)
    with shared.progress_bar() as progress:
        found = call(progress=progress)
    if folder is not None:
        with whole_folder(folder) as part:
            write_json(part / "payload.json", found.to_dict())
            interrupt.too_late()
    if as_json:
        shared.print_json(found.to_dict())
        return
    payload_lines(found, terminal())
    if folder is not None:
        typer.echo("\n" + shared.file_lines(folder, payload="payload.json"))


@from_function("steelyard:contact")
def contact(
    call: "partial[Result]", output: shared.ReportFolder = None, as_json: bool = False
) -> None:
    """Find contacts in a log without a force sensor: when, at which joints, on which link.

    Example: steelyard contact steelyard-ur10e shift.csv --calibrate free1.csv free2.csv
    """
    shared.reported(call, output, as_json, report="report.html")


@from_function(
    "steelyard:external_wrench", sensor_at={"type": str | None, "metavar": '"X Y Z R P Y"'}
)
def wrench(call: "partial[Result]", output: Path | None = None, as_json: bool = False) -> None:
    """Estimate force and moment on a frame along a log, without a force sensor.

    With 95 % intervals, finite in singular postures; names what is not observable. With --measured
    it is compared with a sensor of the log.

    Options:
        output: Output folder for report.html, wrench.csv and wrench.json; none if unset.

    Example: steelyard wrench steelyard-ur10e shift.csv --frame tool0 -o wrench
    """
    shared.reported(call, output, as_json, report="report.html", table="wrench.csv")


@from_function("steelyard:health", logs={"help": f"In the order of time. {shared.LOG_HELP}"})
def health(
    call: "partial[Health]", output: shared.ReportFolder = None, as_json: bool = False
) -> None:
    """Detect drift of friction, offsets and effort scales from logs of normal operation.

    Exit code 0: no drift. 1: something drifted, or may have (drift not proven). 2: error.

    Example: steelyard health steelyard-ur10e monday.csv tuesday.csv -o health
    """
    found = shared.reported(call, output, as_json, report="report.html")
    raise typer.Exit(int(bool(found.drifts or found.unproven)))


@from_function(
    "steelyard:feedforward",
    motion={"help": "trajectory.json, or a table of time and positions; joints match by name."},
    joints=None,
    forces=None,
    contacts={"metavar": "NAME..."},
)
def feedforward(
    call: "partial[FeedforwardTorques]",
    output: Path = Path("feedforward.csv"),
    as_json: bool = False,
) -> None:
    """Compute the joint torques of a model along a desired motion.

    The table has time, positions, velocities, accelerations and torques (q_NAME, dq_NAME, ddq_NAME,
    tau_NAME) in SI units. Friction is computed from the desired velocity: from the measured one
    it would chatter. A robot with a floating base is carried by the contacts of its robot file.

    Options:
        output: Table to write, .csv or .parquet; must not exist.

    Example: steelyard feedforward steelyard-ur10e motion/trajectory.json -o torques.csv
    """
    from rich.text import Text

    from steelyard.report.tables import light_table
    from steelyard.report.terminal import terminal

    refuse_existing(output)
    found = call()
    found.write(output)
    if as_json:
        shared.print_json({**found.to_dict(), "output": str(output)})
        return
    table = light_table(("joint", "RMS", "largest", "unit"), (0, 3))
    table.title, table.title_justify = Text("torque along the motion"), "left"
    for joint, rms, peak in zip(found.joints, found.rms, found.peaks, strict=True):
        cells = (joint.name, significant(rms), significant(peak), joint.effort_unit)
        table.add_row(*(Text(cell) for cell in cells))
    terminal().print(table)
    shared.print_lines(*found.contact_lines)
    shared.print_lines(*(f"! {warning}" for warning in found.warnings), style="bold red")
    shared.print_lines(*(f"note: {note}" for note in found.notes))
    typer.echo(f"\n{len(found.motion)} rows  {output}")

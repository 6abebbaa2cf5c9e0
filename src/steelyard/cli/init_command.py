"""`steelyard init`: a commented robot file with the best guesses."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from steelyard.base.errors import ModelError
from steelyard.base.files import refuse_existing, whole_file
from steelyard.cli import interrupt
from steelyard.cli import shared_by_commands as shared
from steelyard.cli.commands_from_functions import from_function
from steelyard.report.words import count, first_names

if TYPE_CHECKING:
    from steelyard.cli.drive_questions import Stated
    from steelyard.identify.repeated_motion_and_validation_split import ProposedCut
    from steelyard.robot.init.draft_robot_file import Assignment, Draft, Proposal
    from steelyard.robot.init.draft_tables import Known
    from steelyard.runs.runs_of_named_logs import LogArgument

INCOMPLETE = 1  # exit code where the robot file has to be completed before it is of use
_NAMED = 6  # locked joints that are named; the robot file lists all


@from_function(
    model={"help": f"URDF, xacro file or MJCF of the robot. {shared.XACRO_ARGUMENTS_HELP}"}
    | {"metavar": "URDF"},
    rate={"min": 1e-6, "max": 1e6},
    gains={"metavar": "LIST"},
    ratios={"metavar": "LIST"},
    coupling={"metavar": "MOTOR,JOINT,RATIO"},
    zeros={"metavar": "LIST"},
)
def init(
    model: str,
    logs: Annotated[
        list[str] | None,
        typer.Argument(
            help="Logs: columns are guessed from the first, gains and friction from all.",
            metavar="[LOG]...",
        ),
    ] = None,
    output: Path | None = None,
    rate: float | None = None,
    gains: str | None = None,
    ratios: str | None = None,
    side: Literal["motor", "joint"] | None = None,
    coupling: list[str] | None = None,
    zeros: str | None = None,
    calibration: Path | None = None,
    no_input: bool = False,
    fixed_base: str | None = None,
    as_json: bool = False,
) -> None:
    """Write a commented robot file: guesses columns, locks finger joints, copies limits.

    At a terminal it asks what neither the model nor the log contains; Enter skips a question.

    The exit code is 1 if the file is incomplete: columns of some joints are missing in the log or
    not recognised, values contradict the model, or gear ratios are unknown.

    Options:
        output: Robot file to write; must not exist.
        rate: Sampling rate of the log in Hz, if it has no time column.
        gains: Drive gains of currents, Nm (N) at the joint per A, one per joint: 12,12,9.8; with
            --side motor Nm of the motor per A.
        ratios: Gear ratios, if the log has motor-side signals: one per joint, negative if
            opposite: 32,-48. If positions are those of joints, efforts are taken as the motors'.
        side: Side of the gears on which efforts are measured, whatever names say: motor, or joint,
            on which positions are then too.
        coupling: A motor that turns with a second joint: MOTOR is the name of the joint that it
            drives, JOINT the second one, RATIO turns of the motor per turn of JOINT, such as
            joint_6,joint_5,32. Repeatable.
        zeros: Joint positions where the log, or the motor, says zero, in rad (m), or with deg:
            0,-90deg,90deg.
        calibration: LeRobot's calibration of the arm, for its datasets: positions are normalised
            to -100 to 100 or in degrees, a gripper's always 0 to 100. It is ID.json in LeRobot's
            cache, folder calibration.
        no_input: Ask nothing, even at a terminal.

    Example: steelyard init panda.urdf run1.csv -o panda.toml

    Without a time column: steelyard init panda.urdf run1.csv --rate 1000

    Signals of motors: steelyard init arm.urdf run1.csv --side motor --ratios 32,45,-48 --coupling
    wrist,elbow,32
    """
    from steelyard.cli.drive_questions import Stated
    from steelyard.identify.repeated_motion_and_validation_split import ProposedCut, propose_cut
    from steelyard.robot.file.robot_file import load_robot
    from steelyard.robot.init.draft_robot_file import drafted, notes_beside, proposed
    from steelyard.runs.runs_of_named_logs import log_files

    proposal = proposed(model, fixed_base)
    target = output if output is not None else Path(f"{proposal.loaded.stem}.toml")
    refuse_existing(target)
    if not logs:
        of_logs: dict[str, object] = {"--rate": rate, "--gains": gains, "--ratios": ratios}
        of_logs |= {"--side": side, "--coupling": coupling, "--zeros": zeros}
        of_logs |= {"--calibration": calibration}
        fix = "give the log after the model file, or leave it out"
        shared.refuse_options(of_logs, "is given without a log", fix)
    asking = not (no_input or as_json) and sys.stdin.isatty() and sys.stdout.isatty()
    stated = Stated(ratios, coupling or (), gains, zeros, side)
    found = log_files(logs or [])
    assignment, known = examined(proposal, found, rate, stated, asking, calibration)
    draft = drafted(proposal, assignment, target, known)
    with whole_file(target) as part:
        part.write_text(draft.text, encoding="utf-8")
        interrupt.too_late()
    written = proposal.loaded if draft.unreadable else load_robot(target)
    notes = (*proposal.notes, *_locked(draft), *notes_beside(proposal.loaded, written))
    if as_json:
        shared.print_json(
            {
                "robot_file": str(target),
                "complete": not (draft.missing or draft.without_columns),
                "joints": list(draft.identified),
                "without_columns": list(draft.without_columns),
                "columns_found": draft.guess is not None or draft.targets is not None,
                "missing": [{"what": what, "fix": fix} for what, fix in draft.missing],
                "guesses": list(draft.reasons),
                "gains": list(known.gains) or None,
                "friction": "auto" if known.auto else "fixed",
                "notes": list(notes),
            }
        )
    else:
        whole = draft.unreadable or written.signals is None
        parts = ProposedCut(tuple(logs or ())) if whole else propose_cut(written, logs or ())
        show(draft, known, notes, [model, str(target), *(logs or [])], parts)
    if draft.missing or draft.without_columns:
        raise typer.Exit(INCOMPLETE)


def examined(
    proposal: "Proposal",
    logs: "Sequence[LogArgument]",
    rate: float | None,
    stated: "Stated",
    asking: bool,
    calibration: Path | None = None,
) -> "tuple[Assignment, Known]":
    """Joints with their columns, and what else logs and answers contain."""
    from steelyard.check.decision.drive_gains_and_what_init_learns import (
        known_from_logs,
        refuse_other_columns,
    )
    from steelyard.cli import drive_questions as questions
    from steelyard.robot.init.draft_robot_file import assigned, gears_of
    from steelyard.robot.init.draft_tables import Known, with_effort
    from steelyard.robot.init.lerobot_calibration import read_calibration
    from steelyard.runs.runs_of_named_logs import sample_of

    columns, sample = sample_of(logs[0].path) if logs else (None, None)
    spans = None if calibration is None else read_calibration(calibration)
    geared = stated.ratios is not None
    assignment = assigned(proposal, columns, sample, rate, geared, stated.side, spans)
    guess, moving = assignment.guess, assignment.moving
    if spans is not None and assignment.targets is None:
        raise ModelError(
            assignment.problem or "a calibration is for logs of targets without efforts",
            where="--calibration",
            fix="leave the option out, and complete the robot file: position_unit is rad (m) per "
            "logged unit",
        )
    if guess is None:
        return assignment, Known(gravity=questions.mounting_of(_ask) if asking else None)
    refuse_other_columns(logs, guess, moving)
    effort = stated.effort(guess) or (questions.effort_of(guess, _ask) if asking else None)
    gears = stated.gears(guess, moving) or gears_of(proposal, moving, guess)
    asked = asking and guess.motor_side and stated.ratios is None
    if asked and gears is None:
        gears = questions.gears_of(guess, moving, _ask)
    if asked and gears is not None and len(moving) > 1 and gears is not guess.gears:
        gears = replace(gears, coupling=questions.coupling_of(moving, _ask))
    known = known_from_logs(proposal.loaded, moving, logs, with_effort(guess, effort), gears)
    known = stated.added(replace(known, effort=effort, gears=gears), moving)
    if asking:
        of_motors = guess.section.coordinates == "motor" and known.gears is not None
        if asked and of_motors and not known.zeros:
            known = replace(known, zeros=questions.zeros_of(moving, _ask))
        known = questions.with_gains(known, guess, moving, _ask)
        known = replace(known, gravity=questions.mounting_of(_ask))
    return assignment, known


def _ask(question: str, default: str) -> str:
    """The answer at the terminal; Enter gives the default."""
    return str(typer.prompt(f"{question} (Enter: {default})", default, show_default=False))


def _locked(draft: "Draft") -> list[str]:
    """Joints that are locked, if any: those of hands, and those apart from identified ones."""
    lines = []
    for names, why in (
        (draft.hands, "recognised as joints of a hand"),
        (draft.apart, "no columns in the log; apart from the identified joints"),
    ):
        move = "to identify one, move it from [robot.locked] to joints"
        lines += [f"locked {first_names(names, _NAMED)} ({why}); {move}"] if names else []
    return lines


def show(
    draft: "Draft", known: "Known", notes: Sequence[str], named: Sequence[str], parts: "ProposedCut"
) -> None:
    """Print what is written, what was guessed, and what is left to do.

    `named` are model file, robot file and logs as they were given; of `parts` the last validates.
    """
    target = named[1]
    wrong = list(draft.missing)
    if draft.without_columns:
        names = ", ".join(draft.without_columns)
        fix = "state their positions in [robot.locked], or log them; zero is assumed"
        wrong.append((f"the log has no columns of {names}", fix))
    if wrong:
        whats, fixes = zip(*wrong, strict=True)
        written = f"wrote {target}, incomplete: {'; '.join(whats)}"
        shared.print_lines(written, style="bold red", whole=True)
        to_do = (f"to do {fix}" for fix in dict.fromkeys(fixes))
        shared.print_lines(*to_do, style="bold", whole=True)
    else:
        written = f"wrote {target}: {count(len(draft.identified), 'joint')} to identify"
        shared.print_lines(written, whole=True)
    lines = [f"guess {reason}" for reason in draft.reasons]
    lines += [*_beyond_columns(draft, known), *(f"note  {note}" for note in notes)]
    shared.print_lines(*lines, *next_steps(draft, named, parts), whole=True)


def _beyond_columns(draft: "Draft", known: "Known") -> Iterator[str]:
    from steelyard.robot.init.draft_tables import needs_gains, scale_words

    if draft.guess is None:
        return
    if known.gears is not None and "# position_offset" in draft.text:
        yield (
            "zeros     joints are assumed at zero where their motors are; if not, give --zeros, or "
            "state position_offset in [signals]"
        )
    if known.gains:
        left = " Others are identified relative to these." * ("identify" in known.gains)
        yield f"gains from {known.gains_source}.{left}"
    elif needs_gains(draft.guess):
        yield (
            "gains unknown: the log does not contain Nm per A. Write those of the data sheet below "
            "[signals.effort], or weigh a known payload (command there). As written: "
            f"{scale_words(draft.guess)}"
        )
    if known.auto:
        yield f'friction  "auto", laws chosen by cross-validation: {known.friction}'
    elif known.friction:
        yield f'friction  Coulomb and viscous; for "auto" {known.friction}'


def next_steps(draft: "Draft", named: Sequence[str], parts: "ProposedCut") -> list[str]:
    """Commands that follow, with the real names; the arguments are those of `show`."""
    from steelyard.identify.verdict_and_next_steps import identify_command, path_word, step_lines

    target = path_word(named[1])
    if draft.targets is not None:
        *fitted, last = named[2:]
        logs = " ".join(path_word(log) for log in fitted or [last])
        more = f" --validate {path_word(last)}" if fitted else ""
        every = " ".join(path_word(log) for log in named[2:])
        check = (f"steelyard check {target} {every}", "review the lines marked CHECK, then:")
        identify = (f"steelyard identify {target} {logs}{more}", "if nothing is wrong, identify:")
        return step_lines((check, identify), 6)
    given = " ".join(path_word(log) for log in named[2:]) or "LOG..."
    review = "review the lines marked CHECK, then:"
    if len(named) > 3:
        why = "the last log validates the model"
    elif len(parts.logs) > 1:
        why = "; ".join(filter(None, ("the end of the log validates the model", parts.ends)))
    else:
        why = "--validate OTHER_LOG validates the model"
    steps = []
    if not named[2:]:
        design = "review the lines marked CHECK, then design a motion to record:"
        steps = [(f"steelyard excite {target} -o motion", design)]
        review = "with its log (columns are guessed unless [signals] names them):"
    elif draft.missing:
        review = f"correct the above, {review}"
    last = identify_command(named[1], parts.logs or ("LOG...",))
    steps += [
        (f"steelyard check {target} {given}", review),
        (last, f"if no error is found, identify; {why}:"),
    ]
    return step_lines(tuple(steps), 6)

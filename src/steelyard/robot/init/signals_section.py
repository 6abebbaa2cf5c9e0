"""`[signals]` of a new robot file: what is guessed, known from answers, or left to fill in."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from steelyard.robot.file.sections import EffortKind, EffortUnit, Gain, SignalsSection
from steelyard.robot.file.signals import expanded
from steelyard.robot.file.toml_edits import comment, toml_text
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_columns import Guess, recognised
from steelyard.robot.init.guess_efforts import Gears, effort_units
from steelyard.robot.robot import Coordinate

CURRENT_UNITS = ("A", "mA")


@dataclass(frozen=True)
class Effort:
    """Content of the effort columns, as answered; their unit is as guessed if `None`."""

    kind: EffortKind
    unit: EffortUnit | None = None


@dataclass(frozen=True)
class Known:
    """What the robot file states beyond the columns."""

    effort: Effort | None = None  # content of the effort columns; as guessed if `None`
    # joint torque per logged base unit, or `identify`, one per joint; none if unknown
    gains: tuple[Gain, ...] = ()
    gains_source: str = ""  # where they come from, in words
    reference: int = 0  # number of the joint whose gain is set to 1 where none is known
    # gravity in the base frame [m/s²]; the model's if `None`
    gravity: tuple[float, float, float] | None = None
    gears: Gears | None = None  # gears between motors and joints
    # joint positions where the log says zero [rad; m]; none if unknown
    zeros: tuple[float, ...] = ()
    auto: bool = False  # whether friction laws are chosen from the data
    friction: str = ""  # why, or why not, in words; empty without a log


def with_effort(guess: Guess, effort: Effort | None) -> Guess:
    """The guess with the content of its efforts as answered."""
    if effort is None:
        return guess
    section = guess.section
    changes = {"kind": effort.kind} | ({"unit": effort.unit} if effort.unit else {})
    changed = section.effort.model_copy(update=changes)
    left = () if effort.kind == "motor_current" else guess.contradictions
    section = section.model_copy(update={"effort": changed})
    return replace(guess, section=section, contradictions=left)


def current_units(guess: Guess) -> tuple[bool, ...]:
    """Whether each effort column holds a current."""
    unit = guess.section.effort.unit
    units = unit if isinstance(unit, tuple) else (unit,) * len(guess.joints)
    return tuple(one in CURRENT_UNITS for one in units)


def needs_gains(guess: Guess) -> bool:
    """Whether efforts are currents, whose gains the columns do not contain."""
    return any(current_units(guess))


def gains_of(guess: Guess, known: Known) -> tuple[Gain, ...]:
    """Gains that the file states: known ones; else relative to one joint or to the torques beside.

    Without any, the gain of one joint is 1: results are then up to one common scale.
    """
    if known.gains:
        return known.gains
    currents = current_units(guess)
    given: list[Gain] = ["identify" if current else 1.0 for current in currents]
    if all(currents):
        given[known.reference] = 1.0
    return tuple(given)


TO_FILL = "?"  # stands for a column of the log that the user names

KINDS = (
    '"joint_torque": at the joints, with rotors and gears; "link_torque": sensors',
    'on the link side (then remove rotor_inertia from terms); "motor_torque": from the',
    'motors; "motor_current"; or "gravity_compensated_torque".',
)
"""Kinds of efforts, as a comment says them."""


def signals_part(guess: Guess, moving: Sequence[Coordinate], known: Known, file: str) -> str:
    """What the columns of the log seem to be, each guess with its reason."""
    section, effort = guess.section, guess.section.effort
    reasons = "\n".join(comment(reason, "# * ") for reason in guess.reasons)
    wrong = "".join(comment(f"CHECK, contradictory: {why}.") + "\n" for why in guess.contradictions)
    units = tuple(c.unit for c in moving)
    if section.rate is not None:
        clock = "# The log has no time column: sampling rate [Hz].\n" + f"rate = {section.rate!r}"
    else:
        unit = f'{toml_text(section.time_unit)}  # "s", "ms", "us" or "ns"'
        clock = f"time = {toml_text(section.time)}\ntime_unit = {unit}"
    side = '\nside = "motor"  # torques of the motors, through [robot.transmission]'
    side *= effort.side == "motor"
    beside = _side_lines(section, moving, known.zeros) + _velocity_lines(guess)
    position_unit = section.position_unit or (units if len(set(units)) > 1 else units[0])
    return f"""\
# CHECK: the columns of the log. Guessed as follows:
{reasons}
{wrong}[signals]
{clock}
# One column per joint, or a pattern: "q{{}}" for q1, q2, ..., "{{joint}}_q" for the joints' names.
position = {toml_text(section.position)}
position_unit = {toml_text(position_unit)}  # "rad", "deg", "m" or "mm"; or one per joint
# -1 for columns with the opposite sign of their joint.
# position_sign = [{", ".join("1" * len(moving))}]{beside}

[signals.effort]
columns = {toml_text(effort.columns)}
# CHECK: {KINDS[0]}
# {KINDS[1]}
# {KINDS[2]}
kind = {toml_text(effort.kind)}{side}
unit = {toml_text(effort.unit)}  # "A", "mA", "Nm", "N" or "%"; or one per joint
{_gain_lines(guess, known, file)}
# Delay of efforts relative to positions [s].
# delay = 0.0"""


def _side_lines(
    section: SignalsSection, moving: Sequence[Coordinate], zeros: Sequence[float]
) -> str:
    """That positions are the motors', and where the joints are at their zeros."""
    stated = f"\nposition_offset = {toml_text(list(zeros))}  # joint positions at logged zeros"
    if section.coordinates == "joint":
        return stated if zeros else ""
    unknown = f"""
# CHECK: joint positions [rad; m] where the motors' positions are zero.
# position_offset = {toml_text([0.0] * len(moving))}"""
    return f"""
coordinates = "motor"  # positions and velocities are the motors': see [robot.transmission]\
{stated if zeros else unknown}"""


def _gain_lines(guess: Guess, known: Known, file: str) -> str:
    """Gains with where they come from, or how to obtain them."""
    gains = toml_text(gains_of(guess, known))
    if not needs_gains(guess):
        ones = toml_text([1.0] * len(guess.joints))
        return (
            "# Torque at the joint per logged unit, if not 1.0; -1.0 changes the sign.\n"
            f"# gain = {ones}"
        )
    what = "Nm at the joint per A (N per A for a sliding joint), gear ratio included; its sign "
    what += "counts."
    if known.gains:
        lines = [comment(f"{what} From {known.gains_source}.")]
        if "identify" in known.gains:
            lines.append(comment('"identify": relative to the others; a known value is better.'))
        return "\n".join([*lines, f"gain = {gains}"])
    return "\n".join(
        [
            comment(f"CHECK: {what} The log does not contain it. In this order of preference:"),
            comment("(1) data sheet: torque constant times gear ratio, one number per joint;"),
            comment('(2) a second log that carries a known mass: gain = "identify", then'),
            f"#     steelyard identify {file} LOG --loaded LOADED_LOG --payload-mass KG",
            comment(f"(3) as below: {scale_words(guess)}"),
            f"gain = {gains}",
        ]
    )


def scale_words(guess: Guess) -> str:
    """What the gains without any further knowledge mean."""
    if all(current_units(guess)):
        return (
            "one gain is set to 1.0 and the others are identified relative to it: errors in A are "
            "valid; masses, inertias and torques are up to one common scale."
        )
    return "torques and forces are taken as logged, and gains of currents identified beside them."


def _velocity_lines(guess: Guess) -> str:
    section = guess.section
    if section.velocity is None and not guess.velocity:
        return ""
    mark = "" if section.velocity is not None else "# "
    known = "" if section.velocity_unit is not None else "# "
    listed, unit = section.velocity or guess.velocity, guess.velocity_unit or "rad/s"
    return f"""
# Measured velocities are often filtered and late; without them positions are differentiated.
{mark}velocity = {toml_text(listed)}
{known}velocity_unit = {toml_text(unit)}  # or "deg/s", "rpm", "m/s", "mm/s"; or one per joint
# Their delay relative to positions [s].
# velocity_delay = 0.005"""


def signals_template(
    columns: Sequence[str] | None, problem: str, moving: Sequence[Coordinate]
) -> str:
    """Comments to fill in, with the columns of the log if there is one."""
    why = f"{problem}. Fill this in and remove the leading #."
    if columns is None:
        why = "no log was given. Columns are guessed from each log; to set them, fill this in and "
        why += "remove the leading #."
    head = [comment(f"CHECK: {why}")]
    if columns:
        head.append(comment("The log's columns: " + ", ".join(toml_text(c) for c in columns)))
    found, efforts_found = (recognised(q, moving, columns or ()) for q in ("position", "effort"))
    clock = next((c for c in columns or () if Column(c).quantity == "time"), "time")
    listed, efforts = (
        toml_text(expanded(pattern, moving))
        if columns is None
        else toml_text([c.name if c else TO_FILL for c in known or [None] * len(moving)])
        for pattern, known in (("q{}", found), ("tau{}", efforts_found))
    )
    kind, units, gains = _efforts_of(efforts_found, moving)
    ratios = toml_text([100.0] * len(moving))
    lines = [
        "[signals]",
        f"time = {toml_text(clock)}",
        'time_unit = "s"  # "s", "ms", "us" or "ns"; or rate = 100.0 [Hz] instead of both',
        f'position = {listed}  # or a pattern: "q{{}}", "{{joint}}_q"',
        f'position_unit = {toml_text([c.unit for c in moving])}  # "rad", "deg", "m" or "mm"',
        '# coordinates = "motor"  # if positions are the motors\'; then add above [signals]:',
        "# [robot.transmission]",
        f"# ratios = {ratios}  # turns of each motor per turn of its joint",
        "[signals.effort]",
        f"columns = {efforts}",
        f"kind = {toml_text(kind)}  # {KINDS[0]}",
        *(f"# {line}" for line in KINDS[1:]),
        f'unit = {toml_text(units)}  # "A", "mA", "Nm" or "N"',
        f"gain = {toml_text(gains)}  # torque at the joint per logged unit",
    ]
    return "\n".join([*head, *(f"# {line}" for line in lines)])


def _efforts_of(
    found: Sequence[Column | None], moving: Sequence[Coordinate]
) -> tuple[str, list[str], list[Gain]]:
    """Kind, units and gains of efforts, by the names of the columns that are recognised."""
    pairs = [(column, c) for column, c in zip(found, moving, strict=False) if column is not None]
    _, units = effort_units([column for column, _ in pairs], [c for _, c in pairs], {})
    if units and set(units) <= set(CURRENT_UNITS):
        unknown: list[Gain] = ["identify"] * (len(moving) - 1)
        return "motor_current", [units[0]] * len(moving), [1.0, *unknown]
    return "joint_torque", [c.effort_unit for c in moving], [1.0] * len(moving)

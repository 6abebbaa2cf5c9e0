"""Tables of a new robot file: what is guessed, known from answers, or left to fill in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.robot.file.sections import EffortKind, EffortUnit, Gain, SignalsSection
from steelyard.robot.file.signals import expanded
from steelyard.robot.file.toml_edits import comment, toml_text
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_columns import Guess, recognised
from steelyard.robot.init.guess_efforts_and_gears import Gears, effort_units
from steelyard.robot.mechanism import JointSpring
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
    gains: tuple[Gain, ...] = ()  # joint torque per logged base unit, or `identify`, by joint
    gains_source: str = ""  # where they come from, in words
    reference: int = 0  # number of the joint whose gain is set to 1 where none is known
    gravity: tuple[float, float, float] | None = None  # in the base frame [m/s²], not the model's
    gears: Gears | None = None  # gears between motors and joints
    zeros: tuple[float, ...] = ()  # joint positions where the log says zero [rad; m], if known
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
# delay = 0.0
# Joints without a motor, whose effort is zero.
{"" if effort.unactuated else "# "}unactuated = {toml_text(effort.unactuated)}"""


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
    currents = current_units(guess)
    if not any(currents):
        ones = toml_text([1.0] * len(currents))
        return (
            "# Torque at the joint per logged unit, if not 1.0; -1.0 changes the sign.\n"
            f"# gain = {ones}"
        )
    what = "Nm at the joint per A (N per A for a sliding joint), gear ratio included; its sign "
    what += "counts."
    if guess.section.effort.side == "motor":
        what = (
            "Nm of the motor per A (N per A of a linear motor), without the gear; its sign counts."
        )
    gains = list(known.gains)
    if gains:
        lines = [comment(f"{what} From {known.gains_source}.")]
        if "identify" in gains:
            lines.append(comment('"identify": relative to the others; a known value is better.'))
    else:  # relative to one joint or to the torques beside
        gains = ["identify" if current else 1.0 for current in currents]
        gains[known.reference] = 1.0 if all(currents) else gains[known.reference]
        lines = [
            comment(f"CHECK: {what} The log does not contain it. In this order of preference:"),
            comment("(1) data sheet: torque constant times gear ratio, one number per joint;"),
            comment('(2) a second log that carries a known mass: gain = "identify", then'),
            f"#     steelyard identify {file} LOG --loaded LOADED_LOG --payload-mass KG",
            comment(f"(3) as below: {scale_words(guess)}"),
        ]
    return "\n".join([*lines, f"gain = {toml_text(gains)}"])


def scale_words(guess: Guess) -> str:
    """What the gains without any further knowledge mean."""
    if all(current_units(guess)):
        return (
            "one gain is set to 1.0 and the others are identified relative to it: errors are "
            "valid in the unit of the log; masses, inertias and torques are up to one common scale."
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
    found = [recognised(q, moving, columns or ()) for q in ("position", "effort")]
    clock = next((c for c in columns or () if Column(c).quantity == "time"), "time")
    listed, efforts = (
        toml_text(expanded(pattern, moving))
        if columns is None
        else toml_text([c.name if c else TO_FILL for c in known or [None] * len(moving)])
        for pattern, known in zip(("q{}", "tau{}"), found, strict=True)
    )
    kind, units, gains = _efforts_of(found[1], moving)
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


_ALONG = ("rotor_inertia", "coulomb", "viscous")  # terms of a motor that turns with two joints


def gears_part(gears: Gears | None, moving: Sequence[Coordinate]) -> str:
    """The transmission; with unknown ratios a template, commented out."""
    names = [c.name for c in moving]
    motors = ", ".join(f"motor_{k + 1} of {name}" for k, name in enumerate(names))
    head = comment(
        "Turns of each motor per turn of its joint, negative where it turns in the opposite "
        f"direction: {motors}."
    )
    of_joint = names[-2] if len(names) > 1 else names[-1]
    example = f'{{motor = "motor_{len(names)}", joint = {toml_text(of_joint)}, ratio = ?}}'
    coupled = comment(
        "Where a motor turns with a second joint (differential wrist), add it; its rotor and "
        "friction act on both joints: see terms below."
    )
    if gears is None:
        ratios = ", ".join("?" for _ in names)
        return (
            f"# CHECK, to be filled in from the data sheet.\n{head}\n# [robot.transmission]\n"
            f"# ratios = [{ratios}]\n{coupled}\n# coupling = [{example}]"
        )
    entries = ", ".join(
        f"{{motor = {toml_text(f'motor_{i + 1}')}, joint = {toml_text(names[j])}, "
        f"ratio = {toml_text(ratio)}}}"
        for i, j, ratio in gears.coupling
    )
    line = f"coupling = [{entries}]" if entries else f"# coupling = [{example}]"
    return (
        f"{comment(f'CHECK: {gears.source}.')}\n{head}\n[robot.transmission]\n"
        f"ratios = {toml_text(gears.ratios)}\n{coupled}\n{line}"
    )


def model_part(
    springs: Mapping[str, JointSpring], guess: Guess | None, known: Known, gears: Gears | None
) -> str:
    """The torque terms, and whether friction laws are chosen from the data."""
    behind = guess is not None and guess.section.effort.kind == "link_torque"
    laws = [] if known.auto else ["coulomb", "viscous"]
    names = ["rigid_body", *([] if behind else ["rotor_inertia"]), *laws, "offset"]
    tables = [*_spring_lines(springs), *_motor_lines(guess, gears)]
    terms = ", ".join(toml_text(name) for name in names)
    listed = f"[\n  {terms},\n" + "\n".join(tables) + "\n]" if tables else f"[{terms}]"
    if known.auto:
        friction = [
            f"Friction laws are chosen from the logs by cross-validation: {known.friction}.",
            "For ROS 2 packages and other controllers that keep no state between samples: "
            '"auto_memoryless". For fixed laws remove this line and add "coulomb", "viscous" to '
            "terms.",
        ]
    else:
        why = f" Not used: {known.friction}." if known.friction else ""
        friction = [
            'Better with enough motion: friction = "auto", without "coulomb" and "viscous" in '
            "terms, chooses friction laws from the logs by cross-validation. It needs motion "
            f"of every joint in both directions, at several speeds, in one log or more.{why}"
        ]
    line = 'friction = "auto"' if known.auto else '# friction = "auto"'
    return "\n".join([_HEAD, f"terms = {listed}", *map(comment, friction), line])


def _spring_lines(springs: Mapping[str, JointSpring]) -> list[str]:
    """The term of the model file's springs."""
    if not springs:
        return []
    free = [round(spring.free, 12) for spring in springs.values()]
    each = (
        f"{name} {s.stiffness:g}{'' if s.linear else ' and higher powers'}"
        for name, s in springs.items()
    )
    about = f"Springs of the model file, their stiffness there [Nm/rad; N/m]: {', '.join(each)}."
    term = f'{{law = "spring", joints = {toml_text([*springs])}, free = {toml_text(free)}}}'
    return [comment(about, "  # "), f"  {term},"]


def _motor_lines(guess: Guess | None, gears: Gears | None) -> list[str]:
    """Terms of motors that turn with two joints; a comment where gears are unknown."""
    if guess is None or not guess.motor_side:
        return []
    motors = sorted({i for i, _, _ in gears.coupling}) if gears else []
    named = toml_text([f"motor_{i + 1}" for i in motors] or [f"motor_{len(guess.joints)}"])
    mark = "" if motors else "# "
    why = "Rotor and friction of a motor that turns with two joints (coupling)."
    return [
        comment(why, "  # "),
        *(f"  {mark}{{law = {toml_text(law)}, motors = {named}}}," for law in _ALONG),
    ]


_HEAD = """\
[model]
# Torque terms. CHECK: motor torques and currents include "rotor_inertia"; link-side torques do
# not: for link-side torque sensors, remove "rotor_inertia" here and set kind = "link_torque" below;
# with that kind "rotor_inertia" is an error.
# A table gives a law its settings: {law = "coulomb", smoothing = 0.005, joints = ["..."]}."""


SETTINGS = """\
[processing]
# The chain from rows to motion. Lines below a comment show the defaults.
# Hampel threshold in scaled MAD, above which a value is interpolated; or "keep".
# outliers = 15.0
# Rows that repeat the previous positions while the robot moves: "bridge" interpolates, "keep" uses
# them.
# repeats = "bridge"
# Saturated efforts, with the rows around them: "leave_out" excludes, "keep" uses them.
# saturation = "leave_out"
# Resampling to a uniform clock: "cubic", "linear", "pchip" or "spline".
# resampling = "cubic"
# From positions to motion: "auto", "butterworth", "fir", "savitzky_golay", ...; a table gives
# settings: {method = "savitzky_golay", degree = 3}.
# motion = "auto"
# These keys have no fixed default: left out, they are chosen from the data, and `identify` prints
# the choice: rate [Hz] of the uniform clock; motion_cutoff [Hz], low-pass of positions and
# velocities; matched_cutoff [Hz], low-pass of regressor and effort alike; rest_speed [rad/s; m/s],
# up to which a joint rests. Efforts are used as logged unless the key effort is set, such
# as effort = {method = "moving_average", span = 9, passes = 2}.

[prior]
# Prior masses, centres and inertias: those of the "model", or "none". The key uncertainty
# (such as 0.3) sets their relative uncertainty; left out, it is estimated from the data.
# source = "model"
# Example of a prior of a single link, and of a constraint; kinds are "mass", "total_mass",
# "centre_in_box", "parameter", ...
# [prior.links.NAME]
# mass = 3.9
# box = {size = [0.1, 0.1, 0.3], centre = [0.0, 0.0, 0.15]}
# [[knowledge]]
# kind = "total_mass"
# upper = 31.0

[validation]
# Low-pass of measured and predicted effort [Hz]; if left out, 5.0 for the headline and
# matched_cutoff for the other errors.
# cutoff = 5.0"""


def excitation_part(moving: Sequence[Coordinate]) -> str:
    """Limits of motions that `steelyard excite` designs: those of the model."""
    lines = [
        "[excitation.limits]",
        "# Motions of `steelyard excite`: the share of all limits that they may use.",
        "share = 0.95",
    ]
    for name, unit in (("velocity", "rad/s; m/s"), ("effort", "Nm; N")):
        limits = [getattr(c.limits, name) for c in moving]
        missing = [c.name for c, x in zip(moving, limits, strict=True) if not np.isfinite(x)]
        known = "; those of the model above, if left out."
        if missing:
            known = (
                f"; the model has none for {', '.join(missing)}: state them, or defaults are used."
            )
        lines.append(comment(f"Greatest {name} [{unit}], by joint or a list{known}"))
        values = [x if np.isfinite(x) else 1.0 for x in limits]
        lines.append(f"# {name} = {toml_text(values)}")
    lines += [
        "# Greatest acceleration [rad/s²; m/s²]; models have none: 5 rad/s² (1 m/s²) if left out.",
        f"# acceleration = {toml_text([1.0 if c.kind == 'prismatic' else 5.0 for c in moving])}",
        "# Floor [m above the origin of the base]; planes that bound the space of the robot;",
        "# keep_out: boxes that it must not enter; box: one that the tool's sphere must not leave.",
        "# [excitation.workspace]",
        "# floor = 0.0",
    ]
    return "\n".join(lines)

"""`[signals]` of the robot file that `steelyard init` writes: guessed, or left to be filled in."""

from collections.abc import Sequence

from steelyard.robot.robot import Coordinate
from steelyard.robot_file.sections import SignalsSection
from steelyard.robot_file.signals import expanded
from steelyard.robot_file.template.guess_columns import Guess
from steelyard.robot_file.template.text import comment, toml_text


def signals_part(guess: Guess, moving: Sequence[Coordinate]) -> str:
    """What the columns of the log seem to be, each guess with its reason."""
    section, effort = guess.section, guess.section.effort
    reasons = "\n".join(comment(reason, "# * ") for reason in guess.reasons)
    units = tuple(c.unit for c in moving)
    position_unit = section.position_unit or (units if len(set(units)) > 1 else units[0])
    gain = toml_text([1.0] * len(moving))
    if effort.kind == "motor_current":
        gain_lines = (
            "# CHECK: Nm at the joint per A (N per A for a sliding joint), gear ratio included;\n"
            "# the sign counts. 1.0 is a placeholder: a log does not determine it.\n"
            f"gain = {gain}"
        )
    else:
        gain_lines = (
            "# Torque at the joint per logged unit, if not 1.0; -1.0 changes the sign.\n"
            f"# gain = {gain}"
        )
    return f"""\
# CHECK: the columns of the log. Guessed as follows:
{reasons}
[signals]
{_clock_lines(section)}
# One column per joint, or a pattern: "q{{}}" for q1, q2, ..., "{{joint}}_q" for the joints' names.
position = {toml_text(section.position)}
position_unit = {toml_text(position_unit)}  # "rad", "deg", "m" or "mm"; or one per joint
# -1 for columns with the opposite sign of their joint.
# position_sign = [{", ".join("1" * len(moving))}]{_velocity_lines(guess)}

[signals.effort]
columns = {toml_text(effort.columns)}
# CHECK: "joint_torque": at the joints, with rotors and gears; "link_torque": sensors
# behind the gears; "motor_torque": from the motors; "motor_current"; or
# "gravity_compensated_torque".
kind = {toml_text(effort.kind)}
unit = {toml_text(effort.unit)}  # "A", "mA", "Nm", "N" or "%"; or one per joint
{gain_lines}
# Delay of efforts relative to positions [s].
# delay = 0.0"""


def _clock_lines(section: SignalsSection) -> str:
    if section.rate is not None:
        why = "# The log has no time column: sampling rate [Hz]."
        return f"{why}\nrate = {section.rate!r}"
    unit = f'{toml_text(section.time_unit)}  # "s", "ms", "us" or "ns"'
    return f"time = {toml_text(section.time)}\ntime_unit = {unit}"


def _velocity_lines(guess: Guess) -> str:
    section = guess.section
    if section.velocity is None and not guess.velocity:
        return ""
    mark = "" if section.velocity is not None else "# "
    known = "" if section.velocity_unit is not None else "# "
    listed, unit = section.velocity or guess.velocity, section.velocity_unit or "rad/s"
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
    listed = toml_text(expanded("q{}", moving))
    ratios = toml_text([100.0] * len(moving))
    lines = [
        "[signals]",
        'time = "time"',
        'time_unit = "s"  # "s", "ms", "us" or "ns"; or rate = 100.0 [Hz] instead of both',
        f'position = {listed}  # or a pattern: "q{{}}", "{{joint}}_q"',
        f'position_unit = {toml_text([c.unit for c in moving])}  # "rad", "deg", "m" or "mm"',
        '# coordinates = "motor"  # if positions are the motors\'; then add above [signals]:',
        "# [robot.transmission]",
        f"# ratios = {ratios}  # turns of each motor per turn of its joint",
        "[signals.effort]",
        f"columns = {toml_text(expanded('tau{}', moving))}",
        'kind = "joint_torque"  # or "motor_torque", "motor_current"',
        f'unit = {toml_text([c.effort_unit for c in moving])}  # "A", "mA", "Nm" or "N"',
        f"gain = {toml_text([1.0] * len(moving))}  # torque at the joint per logged unit",
    ]
    return "\n".join([*head, *(f"# {line}" for line in lines)])

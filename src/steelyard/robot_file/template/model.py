"""`[robot.transmission]` and `[model]` of the robot file that `steelyard init` writes."""

from collections.abc import Mapping, Sequence

from steelyard.robot.model_notes import JointSpring
from steelyard.robot.robot import Coordinate
from steelyard.robot_file.template.guess_columns import Guess
from steelyard.robot_file.template.guess_motors import Gears
from steelyard.robot_file.template.known import Known
from steelyard.robot_file.template.text import comment, toml_text

_ALONG = ("rotor_inertia", "coulomb", "viscous")
"""Terms of a motor that turns with two joints."""


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
    springs: Mapping[str, JointSpring],
    guess: Guess | None,
    known: Known,
    gears: Gears | None,
) -> str:
    """The torque terms, and whether friction laws are chosen from the data.

    Args:
        springs: Springs of the model file, by joint.
        guess: The columns, whose efforts may be measured on the link side.
        known: Whether friction laws can be chosen.
        gears: Gears, whose coupled motors act on two joints.
    """
    behind = guess is not None and guess.section.effort.kind == "link_torque"
    laws = [] if known.auto else ["coulomb", "viscous"]
    names = ["rigid_body", *([] if behind else ["rotor_inertia"]), *laws, "offset"]
    tables = [*_spring_lines(springs), *_motor_lines(guess, gears)]
    terms = ", ".join(toml_text(name) for name in names)
    listed = f"[\n  {terms},\n" + "\n".join(tables) + "\n]" if tables else f"[{terms}]"
    return f"{_HEAD}\nterms = {listed}\n{_friction_lines(known)}"


def _friction_lines(known: Known) -> str:
    """`friction`, or how to get it."""
    if known.auto:
        why = f"Friction laws are chosen from the logs by cross-validation: {known.friction}."
        instead = (
            "For ROS 2 packages and other controllers that keep no state between samples: "
            '"auto_memoryless". For fixed laws remove this line and add "coulomb", "viscous" to '
            "terms."
        )
        return f'{comment(why)}\n{comment(instead)}\nfriction = "auto"'
    why = f" Not used: {known.friction}." if known.friction else ""
    return (
        comment(
            'Better with enough motion: friction = "auto", without "coulomb" and "viscous" in '
            "terms, chooses friction laws from the logs by cross-validation. It needs motion "
            f"of every joint in both directions, at several speeds, in one log or more.{why}"
        )
        + '\n# friction = "auto"'
    )


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

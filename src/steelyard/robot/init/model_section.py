"""Tables of a new robot file: `[robot.transmission]`, `[model]`, and settings as comments."""

from collections.abc import Mapping, Sequence

import numpy as np

from steelyard.robot.file.toml_edits import comment, toml_text
from steelyard.robot.init.guess_columns import Guess
from steelyard.robot.init.guess_efforts import Gears
from steelyard.robot.init.signals_section import Known
from steelyard.robot.mechanism import JointSpring
from steelyard.robot.robot import Coordinate

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
    springs: Mapping[str, JointSpring],
    guess: Guess | None,
    known: Known,
    gears: Gears | None,
) -> str:
    """The torque terms, and whether friction laws are chosen from the data."""
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

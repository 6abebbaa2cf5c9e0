"""A robot with a floating base as it hangs on a hoist: its base is held, its limbs move."""

from steelyard.excite.constraints.constraint_and_limits import Gap
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot, robot_text
from steelyard.robot.file.toml_edits import Edit, edited


def held_by_its_base(loaded: LoadedRobot) -> tuple[LoadedRobot, Gap | None]:
    """The robot with its base fixed to the world, and what that leaves out; others unchanged."""
    if not loaded.robot.floating:
        return loaded, None
    base = loaded.robot.bodies[0].name
    path = loaded.sources[0].path
    if path.suffix.lower() != ".toml":
        held = load_robot(loaded.reference, base=base)
    else:
        changes = [Edit(("robot", "base"), base)]
        if loaded.signals is not None and loaded.signals.base is not None:
            changes.append(Edit(("signals", "base"), None))
        held = load_robot(path, edited(robot_text(path), changes))
    return held, Gap(
        f"a robot that stands would fall or slip: the motion is for one that hangs, '{base}' held "
        "still and upright, and shows what joints feel there, not the base's mass and inertia; "
        "[excitation.stance] asks for a motion of one that stands"
    )

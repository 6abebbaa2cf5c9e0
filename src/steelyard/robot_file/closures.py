"""Closed chains as a robot file declares them."""

from steelyard.errors import ModelError
from steelyard.robot.loop_closures import Closing
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.ties import Pin
from steelyard.robot_file.sections import RobotSection
from steelyard.robot_file.toml_check import Places
from steelyard.suggest import advice


def closing_of(section: RobotSection, mechanism: Mechanism, places: Places) -> Closing:
    """The closed chains of a robot file.

    Raises:
        ModelError: A loop is between links that do not exist, or two loops have one name.
    """
    names = [link.name for link in mechanism.links]
    pins: list[Pin] = []
    for index, loop in enumerate(section.loops):
        for end, link in enumerate(loop.links):
            if link not in names:
                raise ModelError(
                    f"the model has no link '{link}'",
                    where=places.where("robot", "loops", index, "links", end),
                    fix=advice(link, names, "links"),
                )
        name, where = loop.name or f"loop{index + 1}", places.where("robot", "loops", index)
        if any(pin.name == name for pin in (*mechanism.pins, *pins)):
            raise ModelError(
                f"two loops have the name '{name}'",
                where=where,
                fix="give every loop a name of its own",
            )
        pins.append(Pin(name, loop.links, loop.points, where))
    return Closing(
        tuple(pins), section.passive, section.assembly, section.open_loops, places.where("robot")
    )

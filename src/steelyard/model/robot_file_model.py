"""The model that a robot file describes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from steelyard.base.arguments import checked
from steelyard.base.errors import ModelError
from steelyard.model.laws.coulomb import Coulomb
from steelyard.model.laws.register import DEFAULT_TERMS, refuse_unfit, term_of
from steelyard.model.laws.rotor_inertia import RotorInertia
from steelyard.model.laws.viscous import Viscous
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot


def model_with_open_friction(loaded: LoadedRobot) -> Model:
    """The model of a robot file, with the customary terms where it names none.

    Where friction is to be chosen, it is left out; on the link side no rotor is felt.
    """
    behind = loaded.signals is not None and loaded.signals.effort_kind == "link_torque"
    if loaded.terms is None:
        left: tuple[type[Any], ...] = (RotorInertia,) if behind else ()
        left += (Coulomb, Viscous) if loaded.friction else ()
        return Model(loaded.robot, tuple(t for t in DEFAULT_TERMS if not isinstance(t, left)))
    terms = tuple(term_of(t.description, t.where) for t in loaded.terms)
    gears = loaded.robot.transmission
    motors = set(gears.motors if gears else ()) - set(loaded.robot.joint_names)
    for term, spec in zip(terms, loaded.terms, strict=True):
        refuse_unfit(term, loaded.robot, spec.where)
        named = {name for pair in getattr(term, "pairs", ()) for _, name in pair}
        if behind and (term.on_motors or named & motors):
            raise ModelError(
                f"term '{term.law}' acts on the motors' side, but efforts are link torques, "
                "on the link side",
                where=spec.where,
                fix='leave it out, or use kind = "joint_torque" if efforts are computed from '
                "motor currents",
            )
    return Model(loaded.robot, terms)


def with_friction(model: Model, loaded: LoadedRobot) -> Model:
    """The model with Coulomb and viscous friction where a robot file leaves friction open."""
    return replace(model, terms=(*model.terms, Coulomb(), Viscous())) if loaded.friction else model


@checked()
def model_of(robot: str | Path | LoadedRobot) -> Model:
    """The model that a robot file describes.

    Its terms are those of the file, or rigid bodies, rotors, Coulomb and viscous friction and
    offsets where it names none.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.

    Raises:
        SteelyardError: The file cannot be used.

    Example:
        >>> model_of("arm.toml").robot.n
        2
    """
    loaded = load_robot(robot)
    return with_friction(model_with_open_friction(loaded), loaded)

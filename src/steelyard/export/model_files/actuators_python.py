"""Identified actuators as configurations of Isaac Lab and of mjlab: Python that these import.

Names of their fields are those of `isaaclab.actuators` and `mjlab.actuator`; friction of Isaac Lab
is in Nm from Isaac Sim 5.0 on.
"""

from collections.abc import Iterator, Sequence
from typing import Literal

from steelyard.actuators.actuator_model import ActuatorModel
from steelyard.actuators.actuator_parameters import UNLIMITED
from steelyard.export.model_files.actuators_mjcf import (
    ActuatorFile,
    at_standstill,
    head_lines,
    refuse_beyond_limits,
    unsupported,
)

Framework = Literal["isaaclab", "mjlab"]
LACKS = {
    "isaaclab": ("integral", "stribeck_speed", "load_friction", "dead_band", "mass_factor"),
    "mjlab": ("integral", "stribeck", "load_friction", "dead_band", "back_emf", "mass_factor"),
}
HEAD = {
    "isaaclab": """import re

from isaaclab.actuators import DelayedPDActuatorCfg


def actuators(step):
    \"\"\"Actuators of an ArticulationCfg, by joint, for physics steps of `step` seconds.\"\"\"
    return {""",
    "mjlab": """import re

from mjlab.actuator import BuiltinPositionActuatorCfg


def actuators(step):
    \"\"\"Actuators of an EntityArticulationInfoCfg, for physics steps of `step` seconds.\"\"\"
    return (""",
}

NAMES = {
    "isaaclab": (
        "{0!r}: DelayedPDActuatorCfg(", "joint_names_expr=[re.escape({0!r})]",
        "min_delay", "max_delay",
    ),
    "mjlab": (
        "BuiltinPositionActuatorCfg(", "target_names_expr=(re.escape({0!r}),)",
        "delay_min_lag", "delay_max_lag",
    ),
}  # fmt: skip
"""What begins the configuration of a joint, its field of the joint's name, and those of delays."""


def actuators_python(
    model: ActuatorModel, framework: Framework, units: Sequence[str] = ()
) -> ActuatorFile:
    """A module whose function `actuators(step)` gives one configuration for each joint.

    `units` are lines about other robots of the kind, for the comments.

    Raises:
        ModelError: The fitted motion is outside the limits of the joints.
    """
    refuse_beyond_limits(model)
    lacks = unsupported(model, LACKS[framework])
    lines = head_lines(model, lacks, units, "This configuration")
    comment = "\n".join(f"# {line}" for part in lines for line in part.splitlines())
    body = _configurations(model, framework)
    end = "    }" if framework == "isaaclab" else "    )"
    return ActuatorFile("\n".join([comment, HEAD[framework], *body, end, ""]), lacks)


def _configurations(model: ActuatorModel, framework: Framework) -> Iterator[str]:
    """Lines of the configurations of all joints; no limit where there is none."""
    opened, names, *delays = NAMES[framework]
    friction = at_standstill(model.values)
    for j, joint in enumerate(model.joints):
        v = {name: float(x[j]) for name, x in model.values.values.items()}
        fields = {"stiffness": v["stiffness"], "damping": v["damping"], "armature": v["armature"]}
        if framework == "isaaclab":
            fields |= {"friction": float(friction[j]), "dynamic_friction": v["coulomb"]}
            fields |= {"viscous_friction": v["back_emf"]}
        else:
            fields |= {"damping": v["damping"] + v["back_emf"], "frictionloss": float(friction[j])}
        fields["effort_limit"] = v["torque_limit"]
        yield f"        {opened.format(joint)}"
        yield f"            {names.format(joint)},"
        for name, value in fields.items():
            yield f"            {name}={None if value >= UNLIMITED else value!r},"
        yield from (f"            {name}=round({v['delay']!r} / step)," for name in delays)
        yield "        ),"

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
    body = _isaaclab(model) if framework == "isaaclab" else _mjlab(model)
    end = "    }" if framework == "isaaclab" else "    )"
    return ActuatorFile("\n".join([comment, HEAD[framework], *body, end, ""]), lacks)


def _isaaclab(model: ActuatorModel) -> Iterator[str]:
    for j, joint in enumerate(model.joints):
        v = {name: float(x[j]) for name, x in model.values.values.items()}
        yield f"        {joint!r}: DelayedPDActuatorCfg("
        yield f"            joint_names_expr=[re.escape({joint!r})],"
        yield from _fields(
            stiffness=v["stiffness"],
            damping=v["damping"],
            armature=v["armature"],
            friction=v["coulomb"] + v["stribeck"],
            dynamic_friction=v["coulomb"],
            viscous_friction=v["back_emf"],
            effort_limit=v["torque_limit"],
        )
        yield f"            min_delay=round({v['delay']!r} / step),"
        yield f"            max_delay=round({v['delay']!r} / step),"
        yield "        ),"


def _mjlab(model: ActuatorModel) -> Iterator[str]:
    for j, joint in enumerate(model.joints):
        v = {name: float(x[j]) for name, x in model.values.values.items()}
        yield "        BuiltinPositionActuatorCfg("
        yield f"            target_names_expr=(re.escape({joint!r}),),"
        yield from _fields(
            stiffness=v["stiffness"],
            damping=v["damping"] + v["back_emf"],
            armature=v["armature"],
            frictionloss=float(at_standstill(model.values)[j]),
            effort_limit=v["torque_limit"],
        )
        yield f"            delay_min_lag=round({v['delay']!r} / step),"
        yield f"            delay_max_lag=round({v['delay']!r} / step),"
        yield "        ),"


def _fields(**values: float) -> Iterator[str]:
    """Fields of a configuration; no limit where there is none."""
    for name, value in values.items():
        yield f"            {name}={None if value >= UNLIMITED else value!r},"

"""A model as a ROS 2 package and as an S-function for Simulink, around the C code.

The package is a plugin of `inverse_dynamics_solver` (University of Salerno), of the releases for
Humble and Jazzy, and a node that fills efforts:
https://docs.ros.org/en/jazzy/p/inverse_dynamics_solver
"""

from functools import partial
from xml.sax.saxutils import escape

from steelyard.base.errors import ModelError
from steelyard.export.code.c_code import CCode, commented, filled, self_test
from steelyard.export.code.controller_functions import Function

ROS2_FUNCTIONS = ("torque", "gravity", "bias", "friction", "mass")  # that the package calls
LARGEST_CLOSURE_ERROR = 1e-6  # closure error [m] above which the chains of a robot are open


def ros2_files(code: CCode) -> dict[str, str]:
    """Contents by the paths of the files, of a model in double precision without memory."""
    if code.controller.n_memory:
        raise ModelError(
            "its friction has memory, but inverse_dynamics_solver has no state between calls",
            where=f"model of '{code.controller.model.robot.name}', friction",
            fix='identify with friction = "auto_memoryless", or export with --to c',
        )
    package, robot = f"{code.name}_inverse_dynamics_solver", code.controller.model.robot
    values = code.values | {
        "package": package,
        "escaped": escape(commented(robot.name)),
        "literals": [text_literal(name) for name in robot.joint_names],
        "largest_gap": LARGEST_CLOSURE_ERROR,
        "positional": _needs_position(code.functions["friction"][0]),
        "zeros": max(robot.n, code.passive),
        "q": "joint_positions.data()",
        "dq": "joint_velocities.data()",
        "ddq": "joint_accelerations.data()",
        "call": partial(_call, code),
    }
    return {
        **{
            name: filled(f"ros2/{name}", values)
            for name in ("package.xml", "CMakeLists.txt", "plugin.xml")
        },
        f"src/{code.name}.h": code.header(),
        f"src/{code.name}.c": code.source(),
        **{
            f"src/{name}": filled(f"ros2/{name}", values)
            for name in ("efforts.hpp", "solver.cpp", "fill_efforts.cpp")
        },
        f"test/{code.name}_test.c": self_test(code),
        "README.md": filled("ros2/README.md", values),
    }


def text_literal(text: str) -> str:
    """A string literal of C++ with the UTF-8 bytes of a text."""
    plain = (
        chr(x) if 32 <= x < 127 and chr(x) not in '"\\?' else f"\\{x:03o}" for x in text.encode()
    )
    return f'"{"".join(plain)}"'


def _call(code: CCode, function: str, q: str, *rest: str) -> str:
    """A call of a function of the C code, with the passive joints of closed chains."""
    passive = (f"Chains({q}).passive",) if code.passive else ()
    return f"{code.name}_{function}({', '.join((q, *passive, *rest))});"


def _needs_position(function: Function) -> bool:
    """Whether a function of `q` and `dq` reads positions."""
    place = len(function.program.inputs) - 1
    return any(
        step.operation == "input" and step.arguments[0] < place
        for step in function.program.pruned().steps
    )


LONGEST_NAME = 63  # characters of names in MATLAB


def simulink_files(code: CCode) -> dict[str, str]:
    """Contents by the names of the files, of a model in double precision."""
    block = f"{code.name[: LONGEST_NAME - len('make__sfun')]}_sfun"
    values = code.values | {"block": block}
    return {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": code.source(),
        f"{code.name}_test.c": self_test(code),
        f"{block}.c": filled("simulink/s_function.c", values),
        f"make_{block}.m": f"% Compile the S-function {block}.\nmex {block}.c {code.name}.c\n",
        "README.md": filled("simulink/README.md", values),
    }

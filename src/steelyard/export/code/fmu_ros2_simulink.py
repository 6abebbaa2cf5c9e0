"""Around the C code of a model: FMI 2.0, a ROS 2 package and an S-function of Simulink.

The ROS 2 package is a plugin of `inverse_dynamics_solver` (University of Salerno), of the releases
for Humble and Jazzy, and a node that fills efforts:
https://docs.ros.org/en/jazzy/p/inverse_dynamics_solver
"""

import hashlib
import platform
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from steelyard.base.errors import ModelError, OutputError
from steelyard.export.code.c_code import CCode, commented, filled, self_test
from steelyard.export.code.controller_functions import Function
from steelyard.robot.loop_closures import loop_equations

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
        "zeros": max(robot.n, len(robot.passive)),
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
    passive = (f"Chains({q}).passive",) if code.controller.model.robot.passive else ()
    return f"{code.name}_{function}({', '.join((q, *passive, *rest))});"


def _needs_position(function: Function) -> bool:
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


PLATFORMS = {
    ("Linux", "x86_64"): ("linux64", ".so"),
    ("Darwin", "x86_64"): ("darwin64", ".dylib"),
    ("Windows", "AMD64"): ("win64", ".dll"),
}
"""Platforms that FMI 2.0 has names for; other ones compile the sources."""

FMI_UNITS = {
    "rad": '<BaseUnit rad="1"/>',
    "rad/s": '<BaseUnit rad="1" s="-1"/>',
    "rad/s2": '<BaseUnit rad="1" s="-2"/>',
    "m": '<BaseUnit m="1"/>',
    "m/s": '<BaseUnit m="1" s="-1"/>',
    "m/s2": '<BaseUnit m="1" s="-2"/>',
    "N.m": '<BaseUnit kg="1" m="2" s="-2"/>',
    "N": '<BaseUnit kg="1" m="1" s="-2"/>',
}


class Variable(NamedTuple):
    """An input or output; its unit is one of `FMI_UNITS`, outputs have no start."""

    name: str
    unit: str
    start: float | None
    meaning: str


def variables_of(code: CCode) -> list[Variable]:
    """Positions, velocities and accelerations, then efforts; with loops the closure error."""
    robot = code.controller.model.robot
    reference = loop_equations(robot).assembly if robot.passive else np.zeros(robot.n)
    joints = list(zip(code.joints, robot.joint_names, robot.coordinates, strict=True))
    found: list[Variable] = []
    inputs = ("q", "", "position"), ("dq", "/s", "velocity"), ("ddq", "/s2", "acceleration")
    for prefix, per, meaning in inputs:
        for k, (plain, name, joint) in enumerate(joints):
            start = float(reference[k]) if prefix == "q" else 0.0
            unit = joint.unit + per
            found.append(Variable(f"{prefix}_{plain}", unit, start, f"{meaning} of joint {name}"))
    for plain, name, joint in joints:
        unit = "N" if joint.kind == "prismatic" else "N.m"
        found.append(Variable(f"tau_{plain}", unit, None, f"effort of joint {name}"))
    if robot.passive:
        meaning = "largest distance of two points that close a chain"
        found.append(Variable("closure_error", "m", None, meaning))
    return found


def write_fmu(code: CCode, path: Path) -> tuple[str, ...]:
    """Write the FMU, with a binary if there is a compiler; the names of its files."""
    source, variables = code.source(), variables_of(code)
    guid = "{" + hashlib.sha256(source.encode()).hexdigest()[:32] + "}"
    starts = [repr(v.start) for v in variables if v.start is not None]
    sources = {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": source,
        f"{code.name}_fmi2.c": filled("fmu/fmi2.c", code.values | {"guid": guid, "starts": starts}),
    }
    files = {f"sources/{name}": text.encode() for name, text in sources.items()}
    described = {
        "name": code.name,
        "robot": code.controller.model.robot.name,
        "guid": guid,
        "units": FMI_UNITS,
        "variables": variables,
        "quoted": quoteattr,
    }
    files["modelDescription.xml"] = filled("fmu/modelDescription.xml", described).encode()
    files |= _binary(code.name, sources)
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        for name in sorted(files):
            # a fixed date: the same model is the same file
            archive.writestr(ZipInfo(name, (1980, 1, 1, 0, 0, 0)), files[name], ZIP_DEFLATED)
    return tuple(sorted(files))


def compiler() -> str | None:
    """A C compiler on the search path."""
    return next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)


def _binary(name: str, sources: dict[str, str]) -> dict[str, bytes]:
    """The shared library for this platform by its place in the FMU; none without a compiler."""
    known = PLATFORMS.get((platform.system(), platform.machine()))
    found = compiler()
    if known is None or found is None:
        return {}
    folder, target = known[0], f"{name}{known[1]}"
    with tempfile.TemporaryDirectory() as place:
        for file, text in sources.items():
            (Path(place) / file).write_text(text, encoding="utf-8")
        command = [found, "-std=c99", "-O2", "-shared", "-fPIC"]
        command += [file for file in sources if file.endswith(".c")]
        done = subprocess.run([*command, "-o", target, "-lm"], cwd=place, capture_output=True)
        if done.returncode:
            raise OutputError(
                f"the compiler fails: {done.stderr.decode(errors='replace')[:200]}",
                where=found,
                fix="check that it compiles C, or take it off the search path: the FMU then has "
                "the sources alone",
            )
        return {f"binaries/{folder}/{target}": (Path(place) / target).read_bytes()}

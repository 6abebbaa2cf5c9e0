"""A model as a functional mock-up unit: FMI 2.0 co-simulation, around the C code."""

import hashlib
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from steelyard.base.errors import OutputError
from steelyard.export.code.c_code import CCode, filled
from steelyard.robot.loop_closures import loop_equations

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

    @property
    def causality(self) -> str:
        """Whether it is an input or an output."""
        return "output" if self.start is None else "input"


def variables_of(code: CCode) -> list[Variable]:
    """Positions, velocities and accelerations, then efforts; with loops the closure error."""
    robot = code.controller.model.robot
    reference = loop_equations(robot).assembly if robot.passive else np.zeros(robot.n)
    joints = list(zip(code.joints, robot.joint_names, robot.coordinates, strict=True))
    found: list[Variable] = []
    for prefix, per, meaning in (
        ("q", "", "position"),
        ("dq", "/s", "velocity"),
        ("ddq", "/s2", "acceleration"),
    ):
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


def model_description(code: CCode, guid: str) -> str:
    """The content of `modelDescription.xml`."""
    values = {
        "name": code.name,
        "robot": code.controller.model.robot.name,
        "guid": guid,
        "units": FMI_UNITS,
        "variables": variables_of(code),
        "quoted": quoteattr,
    }
    return filled("fmu/modelDescription.xml", values)


def write_fmu(code: CCode, path: Path) -> tuple[str, ...]:
    """Write the FMU, with a binary if there is a compiler; the names of its files."""
    source = code.source()
    guid = "{" + hashlib.sha256(source.encode()).hexdigest()[:32] + "}"
    starts = [repr(v.start) for v in variables_of(code) if v.start is not None]
    values = code.values | {"guid": guid, "starts": starts}
    sources = {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": source,
        f"{code.name}_fmi2.c": filled("fmu/fmi2.c", values),
    }
    files = {f"sources/{name}": text.encode() for name, text in sources.items()}
    files["modelDescription.xml"] = model_description(code, guid).encode()
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

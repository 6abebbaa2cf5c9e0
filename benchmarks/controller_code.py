"""Exported C code of seven joints with friction, beside Pinocchio from Python and from C++.

Pinocchio computes the rigid bodies alone. From C++ it is called where its headers and those of
Eigen (`pip install cmeel-eigen`) are installed; both programs are compiled by the same compiler
with the same options and call their function at the same states.
"""

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from steelyard.base.arrays import Parameters
from steelyard.export.code.c_code import CCode
from steelyard.export.code.controller_functions import Controller
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.model.model import Model
from steelyard.robot.robot import Robot

STATES, ROUNDS = 256, 2000
OPTIONS = ("-O2",)
Best = Callable[[Callable[[], object], int], float]
Row = tuple[str, str, str, bool]


def controller_code(best: Best, model: Model) -> list[Row]:
    """All rows."""
    if shutil.which("gcc") is None:
        return [("exported C code", "gcc is not installed", "", True)]
    values = np.random.default_rng(0).uniform(0.1, 1.0, len(model.names))
    nominal = model.robot.nominal.ravel()
    values[: len(nominal)] = nominal
    known = Parameters(model.names, model.units, values)
    whole = Controller(model, known, frames=(last_frame(model.robot),))
    torque = replace(whole, names=("torque",), frames=())
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        ours = _seconds_of_c(torque, Path(folder))
        rows.append(("torque in C", f"{1e9 * ours:.0f} ns a call", "<= 300 ns", ours <= 3e-7))
        for name, controller in (("torque", torque), ("all usual functions", whole)):
            size = _object_size(controller, Path(folder))
            bound = "<= 30 kB" if controller is torque else ""
            figure = f"{size / 1000:.1f} kB, stack {CCode(controller, 'double', ()).stack} bytes"
            rows.append((f"object of {name} in C", figure, bound, not bound or size <= 30_000))
        python = _seconds_of_python(best, model)
        figure = f"{1e9 * python:.0f} ns a call, ratio {python / ours:.1f}"
        rows.append(("rnea of Pinocchio from Python", figure, "", True))
        theirs = _seconds_of_cpp(model.robot, Path(folder))
        figure = "not built: pip install cmeel-eigen"
        if theirs is not None:
            figure = f"{1e9 * theirs:.0f} ns a call, ratio {theirs / ours:.1f}"
        rows.append(("rnea of Pinocchio from C++", figure, "", True))
    return rows


def _states(n: int) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(STATES, 3 * n))


def states_table(n: int) -> str:
    """States as an array in C: positions, velocities, accelerations."""
    rows = ",\n".join("{" + ", ".join(map(repr, row)) + "}" for row in _states(n).tolist())
    return f"static const double x[{STATES}][{3 * n}] = {{\n{rows}\n}};\n"


def timed(program: Path) -> float:
    """Seconds a call that a program prints; the least of some runs."""
    runs = [subprocess.run([program], capture_output=True, text=True, check=True) for _ in range(5)]
    return min(float(run.stdout) for run in runs)


CLOCK = """
static double now(void) { return (double)clock() / CLOCKS_PER_SEC; }
"""


def _seconds_of_c(controller: Controller, folder: Path) -> float:
    code, n = CCode(controller, "double", ()), controller.model.robot.n
    (folder / f"{code.name}.h").write_text(code.header())
    (folder / f"{code.name}.c").write_text(code.source())
    (folder / "main.c").write_text(f"""\
#include "{code.name}.h"
#include <stdio.h>
#include <time.h>
{states_table(n)}{CLOCK}
int main(void) {{
    double tau[{n}], sum = 0.0;
    const double start = now();
    for (int round = 0; round < {ROUNDS}; ++round)
        for (int k = 0; k < {STATES}; ++k) {{
            {code.name}_torque(x[k], x[k] + {n}, x[k] + {2 * n}, tau);
            sum += tau[0];
        }}
    printf("%.12g\\n", (now() - start) / {float(ROUNDS * STATES)});
    return sum == 0.123;
}}
""")
    sources = [folder / f"{code.name}.c", folder / "main.c"]
    command = ["gcc", "-std=c99", *OPTIONS, *sources, "-o", folder / "ours", "-lm"]
    subprocess.run(command, check=True)
    return timed(folder / "ours")


def _object_size(controller: Controller, folder: Path) -> int:
    """Bytes of machine code and constants."""
    code = CCode(controller, "double", ())
    (folder / f"{code.name}.h").write_text(code.header())
    (folder / f"{code.name}.c").write_text(code.source())
    command = ["gcc", "-std=c99", "-O2", "-c", folder / f"{code.name}.c", "-o", folder / "a.o"]
    subprocess.run(command, check=True)
    printed = subprocess.run(["size", folder / "a.o"], capture_output=True, text=True, check=True)
    return sum(int(x) for x in printed.stdout.splitlines()[1].split()[:3])


def _seconds_of_python(best: Best, model: Model) -> float:
    from oracles import pinocchio_model

    oracle, n = pinocchio_model(model.robot), model.robot.n
    data = oracle.createData()
    samples = [np.split(row, 3) for row in _states(n)]

    def loop() -> None:
        for q, dq, ddq in samples:
            pin.rnea(oracle, data, q, dq, ddq)

    return best(loop, 100) / STATES


def _seconds_of_cpp(robot: Robot, folder: Path) -> float | None:
    prefix = Path(pin.__file__).parents[4]
    headers, library = prefix / "include", prefix / "lib"
    if shutil.which("g++") is None:
        return None
    (folder / "main.cpp").write_text(_cpp(robot))
    command = [
        "g++", "-std=c++17", *OPTIONS, "-w", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION",
        "-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
        f"-I{headers}", f"-I{headers / 'eigen3'}", "-I/usr/include/eigen3", folder / "main.cpp",
        "-o", folder / "theirs", f"-L{library}", f"-Wl,-rpath,{library}", "-lpinocchio_default",
    ]  # fmt: skip
    built = subprocess.run(command, capture_output=True)
    return timed(folder / "theirs") if built.returncode == 0 else None


def _cpp(robot: Robot) -> str:
    """A program that builds the robot's bodies and calls rnea."""

    def numbers(values: np.ndarray) -> str:
        return ", ".join(map(repr, np.asarray(values, dtype=float).ravel().tolist()))

    joints = []
    for body in robot.bodies:
        ten = body.inertia.ten
        joints.append(
            f"place << {numbers(np.c_[body.rotation, body.position])};\n"
            f"    axis << {numbers(body.axis)};\n"
            f"    ten << {numbers(ten)};\n"
            f"    add({body.parent + 1}, place, axis, ten);"
        )
    n = robot.n
    return f"""\
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>
{states_table(n)}{CLOCK}
using namespace pinocchio;
static Model model;
static void add(int parent, const Eigen::Matrix<double, 3, 4>& place, const Eigen::Vector3d& axis,
                const Eigen::Matrix<double, 10, 1>& ten) {{
    SE3 at(place.leftCols<3>(), place.col(3));
    const std::string name = "joint" + std::to_string(model.njoints);
    const auto k = model.addJoint(parent, JointModelRevoluteUnaligned(axis), at, name);
    model.appendBodyToJoint(k, Inertia::FromDynamicParameters(ten), SE3::Identity());
}}
int main() {{
    Eigen::Matrix<double, 3, 4> place;
    Eigen::Vector3d axis;
    Eigen::Matrix<double, 10, 1> ten;
    model.gravity.linear() << {numbers(robot.gravity)};
    {(chr(10) + "    ").join(joints)}
    Data data(model);
    std::vector<Eigen::VectorXd> q, dq, ddq;
    for (int k = 0; k < {STATES}; ++k) {{
        q.push_back(Eigen::Map<const Eigen::VectorXd>(x[k], {n}));
        dq.push_back(Eigen::Map<const Eigen::VectorXd>(x[k] + {n}, {n}));
        ddq.push_back(Eigen::Map<const Eigen::VectorXd>(x[k] + {2 * n}, {n}));
    }}
    double sum = 0.0;
    const double start = now();
    for (int round = 0; round < {ROUNDS}; ++round)
        for (int k = 0; k < {STATES}; ++k) sum += rnea(model, data, q[k], dq[k], ddq[k])[0];
    std::printf("%.12g\\n", (now() - start) / {float(ROUNDS * STATES)});
    return sum == 0.123;
}}
"""

"""The folder of a C export: header, source, self-test, CMakeLists and README."""

from steelyard.application.controller.c_code import CCode, joint_lines
from steelyard.application.controller.c_test import TOLERANCE, self_test
from steelyard.application.controller.identifiers import commented


def c_files(code: CCode) -> dict[str, str]:
    """Contents by the names of the files."""
    return {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": code.source(),
        f"{code.name}_test.c": self_test(code),
        "CMakeLists.txt": _cmake(code.name),
        "README.md": _readme(code),
    }


def _cmake(name: str) -> str:
    return f"""\
cmake_minimum_required(VERSION 3.10)
project({name}_dynamics C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library({name}_dynamics STATIC {name}.c)
target_include_directories({name}_dynamics PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
find_library(MATH_LIBRARY m)
if(MATH_LIBRARY)
  target_link_libraries({name}_dynamics PUBLIC ${{MATH_LIBRARY}})
endif()

enable_testing()
add_executable({name}_test {name}_test.c)
target_link_libraries({name}_test PRIVATE {name}_dynamics)
add_test(NAME {name}_test COMMAND {name}_test)
"""


def _readme(code: CCode) -> str:
    controller, name, real = code.controller, code.name, code.precision
    robot = controller.model.robot
    joints = zip(joint_lines(robot.coordinates), code.joints, strict=True)
    rows = "\n".join(
        f"| {commented(line.strip())} | `{name.upper()}_JOINT_{joint.upper()}` |"
        for line, joint in joints
    )
    functions = "\n".join(
        f"| `{name}_{call}` | {commented(f.meaning)} | {c.operations} | {c.stack} |"
        for call, (f, c) in code.functions.items()
        if f.public
    )
    return f"""\
# Dynamics of {commented(robot.name)} in C

{name}.h and {name}.c compute in {real} precision what the identified model computes. They are C99
and C++, need `<math.h>` only, allocate no memory and keep no variables between calls.

    cmake -B build && cmake --build build && ctest --test-dir build
    cc -std=c99 -O2 {name}.c {name}_test.c -lm -o {name}_test && ./{name}_test

`{name}_test` compares the functions with values that Python computed. Compilers that contract
products and sums into one operation (FMA; `-ffp-contract`) change the last bits of results, and
mathematical libraries differ in theirs: compare with a tolerance, as the test does
({TOLERANCE[real]:g} relative to one plus the value's size).

| Joint [position, effort] | number |
|---|---|
{rows}

| Function | result | operations | stack [bytes] |
|---|---|---|---|
{functions}

- Angles are in rad, prismatic positions in m, velocities and accelerations in the same units per s
  and s²; efforts in Nm and N. Matrices are stored row by row. Results must not overlap arguments.
- Arguments are not checked. Beyond 1e5 rad sine and cosine lose digits where a library does not
  reduce angles exactly; Python refuses such angles. Check that arguments are finite numbers:
  results of others are not to be used.
- Base parameters that are zero, removed or not identified, are left out; the header lists the
  others.
- Feedforward takes friction from the desired velocity: friction of the measured velocity changes
  sign with its noise.
{_closed(code)}{_memory(code)}{_observer(code)}"""


def _closed(code: CCode) -> str:
    if not code.state.passive:
        return ""
    return f"""\
- Closed chains: positions are those of the driven joints. `{code.name}_follow` finds the passive
  joints at the first sample, `{code.name}_close` at every further one, from those of the sample
  before; both return the closure error. A passive joint must not move by more than about 0.5 rad
  between two samples.
"""


def _observer(code: CCode) -> str:
    numbers = code.observer.numbers
    if numbers is None:
        return ""
    contact = ""
    if numbers.thresholds is not None:
        contact = f"""\
  `{code.name}_observer_contact` compares them with thresholds of contact for
  {numbers.thresholds.rate:.3g} false alarms per hour at {numbers.bandwidth:g} Hz; changes at rest,
  which `steelyard contact` tests as well, are not compared. They are of smoothed motion: take as
  contact what lasts for two samples or more, as velocities jump at abrupt stops.
"""
    return f"""\
- External efforts: `{code.name}_observer_start` and `{code.name}_observer_step` observe them from
  positions, velocities and joint efforts of consecutive samples; times are of type `double`.
{contact}"""


def _memory(code: CCode) -> str:
    if not code.state.memory:
        return ""
    return f"""\
- Friction remembers the motion: `{code.name}_start` and `{code.name}_step` compute the efforts of
  consecutive samples. There is no function of one sample alone for the torque of all terms, for
  friction and for the regressor: without the state they are not defined.
"""

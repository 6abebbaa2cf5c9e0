"""A model as a ROS 2 package: a plugin of `inverse_dynamics_solver`, and a node that fills efforts.

The interface is that of the package `inverse_dynamics_solver` (University of Salerno), of the
releases for Humble and Jazzy: https://docs.ros.org/en/jazzy/p/inverse_dynamics_solver
"""

from xml.sax.saxutils import escape

from steelyard.base.errors import ModelError
from steelyard.export.code.c_code import CCode, commented, joint_list
from steelyard.export.code.c_files import self_test
from steelyard.export.code.functions import Function

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
    package = f"{code.name}_inverse_dynamics_solver"
    return {
        "package.xml": _package_xml(code, package),
        "CMakeLists.txt": _cmake(code.name, package),
        "plugin.xml": _plugin_xml(code, package),
        f"src/{code.name}.h": code.header(),
        f"src/{code.name}.c": code.source(),
        "src/efforts.hpp": _efforts(code, package),
        "src/solver.cpp": _solver(code, package),
        "src/fill_efforts.cpp": _node(package),
        f"test/{code.name}_test.c": self_test(code),
        "README.md": _readme(code, package),
    }


def text_literal(text: str) -> str:
    """A string literal of C++ with the UTF-8 bytes of a text."""
    plain = (
        chr(x) if 32 <= x < 127 and chr(x) not in '"\\?' else f"\\{x:03o}" for x in text.encode()
    )
    return f'"{"".join(plain)}"'


def _package_xml(code: CCode, package: str) -> str:
    robot = commented(code.controller.model.robot.name)
    depends = ("eigen", "inverse_dynamics_solver", "pluginlib", "rclcpp", "trajectory_msgs")
    rows = "\n".join(f"  <depend>{name}</depend>" for name in depends)
    return f"""\
<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>0.1.0</version>
  <description>Identified inverse dynamics of {escape(robot)}, written by steelyard.</description>
  <maintainer email="maintainer@example.com">maintainer</maintainer>
  <license>Proprietary</license>

  <buildtool_depend>ament_cmake</buildtool_depend>
{rows}

  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""


def _plugin_xml(code: CCode, package: str) -> str:
    robot = commented(code.controller.model.robot.name)
    return f"""\
<library path="{package}">
  <class base_class_type="inverse_dynamics_solver::InverseDynamicsSolver"
         type="{package}::Solver" name="{package}/Solver">
    <description>Identified inverse dynamics of {escape(robot)}.</description>
  </class>
</library>
"""


def _cmake(name: str, package: str) -> str:
    return f"""\
cmake_minimum_required(VERSION 3.10)
project({package} C CXX)

set(CMAKE_C_STANDARD 99)
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

find_package(ament_cmake REQUIRED)
find_package(Eigen3 REQUIRED)
find_package(inverse_dynamics_solver REQUIRED)
find_package(pluginlib REQUIRED)
find_package(rclcpp REQUIRED)
find_package(trajectory_msgs REQUIRED)

add_library({name}_dynamics STATIC src/{name}.c)
target_include_directories({name}_dynamics PUBLIC src)
target_link_libraries({name}_dynamics PUBLIC m)

add_library({package} SHARED src/solver.cpp)
target_link_libraries({package} {name}_dynamics)
ament_target_dependencies({package} Eigen3 inverse_dynamics_solver pluginlib)
pluginlib_export_plugin_description_file(inverse_dynamics_solver plugin.xml)

add_executable(fill_efforts src/fill_efforts.cpp)
target_link_libraries(fill_efforts {name}_dynamics)
ament_target_dependencies(fill_efforts rclcpp trajectory_msgs)

install(TARGETS {package} ARCHIVE DESTINATION lib LIBRARY DESTINATION lib RUNTIME DESTINATION bin)
install(TARGETS fill_efforts DESTINATION lib/${{PROJECT_NAME}})

if(BUILD_TESTING)
  add_executable({name}_test test/{name}_test.c)
  target_link_libraries({name}_test {name}_dynamics)
  add_test(NAME {name}_test COMMAND {name}_test)
endif()

ament_package()
"""


def _efforts(code: CCode, package: str) -> str:
    name, names = code.name, code.controller.model.robot.joint_names
    chains = f"""\
/* Positions of the passive joints at q. */
struct Chains {{
    double passive[{code.passive}];
    explicit Chains(const double *q)
    {{
        if (!({name}_follow(q, passive) < {LARGEST_CLOSURE_ERROR!r})) {{
            throw std::domain_error("the chains of the robot do not close at these positions");
        }}
    }}
}};

"""
    return f"""\
/* Efforts of trajectories by {name}.c. */
#ifndef {package.upper()}_EFFORTS_HPP
#define {package.upper()}_EFFORTS_HPP

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "{name}.h"

namespace {package}
{{

constexpr std::size_t JOINTS = {len(names)};

{chains if code.passive else ""}\
/* Names of the joints in the order of {name}.c. */
inline const std::array<std::string, JOINTS> & joint_names()
{{
    static const std::array<std::string, JOINTS> names{{{{
        {(chr(44) + chr(10) + " " * 8).join(map(text_literal, names))}
    }}}};
    return names;
}}

/* Fill the efforts of all points; joints may be in any order.
   Throws std::invalid_argument where a joint, position, velocity or acceleration is missing. */
template <class Trajectory>
void fill_efforts(Trajectory & trajectory)
{{
    const auto & given = trajectory.joint_names;
    std::array<std::size_t, JOINTS> places{{}};
    for (std::size_t k = 0; k < JOINTS; ++k) {{
        const auto found = std::find(given.begin(), given.end(), joint_names()[k]);
        if (found == given.end()) {{
            throw std::invalid_argument("joint '" + joint_names()[k] + "' is missing");
        }}
        places[k] = static_cast<std::size_t>(found - given.begin());
    }}
    if (given.size() != JOINTS) {{
        throw std::invalid_argument(
            "the trajectory has " + std::to_string(given.size()) + " joints, the model " +
            std::to_string(JOINTS));
    }}
    std::vector<std::vector<double>> efforts;
    for (const auto & point : trajectory.points) {{
        if (point.positions.size() != JOINTS || point.velocities.size() != JOINTS ||
            point.accelerations.size() != JOINTS) {{
            throw std::invalid_argument(
                "point " + std::to_string(efforts.size()) +
                " needs a position, a velocity and an acceleration of every joint");
        }}
        double q[JOINTS], dq[JOINTS], ddq[JOINTS], tau[JOINTS];
        for (std::size_t k = 0; k < JOINTS; ++k) {{
            q[k] = point.positions[places[k]];
            dq[k] = point.velocities[places[k]];
            ddq[k] = point.accelerations[places[k]];
        }}
        {_call(code, "torque", "q", "dq", "ddq", "tau")}
        efforts.emplace_back(JOINTS);
        for (std::size_t k = 0; k < JOINTS; ++k) {{
            efforts.back()[places[k]] = tau[k];
        }}
    }}
    for (std::size_t i = 0; i < efforts.size(); ++i) {{
        trajectory.points[i].effort = efforts[i];
    }}
}}

}}  // namespace {package}

#endif
"""


def _call(code: CCode, function: str, q: str, *rest: str) -> str:
    """A call of a function of the C code, with the passive joints of closed chains."""
    passive = (f"Chains({q}).passive",) if code.passive else ()
    return f"{code.name}_{function}({', '.join((q, *passive, *rest))});"


def _solver(code: CCode, package: str) -> str:
    q, dq, ddq = (f"joint_{x}.data()" for x in ("positions", "velocities", "accelerations"))
    return f"""\
/* Plugin of inverse_dynamics_solver around {code.name}.c. */
#include <inverse_dynamics_solver/inverse_dynamics_solver.hpp>
#include <pluginlib/class_list_macros.hpp>

#include <stdexcept>
#include <string>

#include "efforts.hpp"

namespace {package}
{{

using Eigen::MatrixXd;
using Eigen::VectorXd;

static VectorXd vector_of(const double (&values)[JOINTS])
{{
    VectorXd found(static_cast<int>(JOINTS));
    std::copy(values, values + JOINTS, found.data());
    return found;
}}

static void check(const VectorXd & values)
{{
    if (static_cast<std::size_t>(values.size()) != JOINTS) {{
        throw std::invalid_argument(
            std::to_string(values.size()) + " values of " + std::to_string(JOINTS) + " joints");
    }}
}}

class Solver : public inverse_dynamics_solver::InverseDynamicsSolver
{{
public:
    /* The model is part of the code: no parameter and no robot description is read. */
    void initialize(
        rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr, const std::string &,
        const std::string &) override
    {{
    }}

    MatrixXd getInertiaMatrix(const VectorXd & joint_positions) const override
    {{
        check(joint_positions);
        MatrixXd matrix(static_cast<int>(JOINTS), static_cast<int>(JOINTS));
        /* symmetric: rows are columns */
        {_call(code, "mass", q, "matrix.data()")}
        return matrix;
    }}

    VectorXd getCoriolisVector(
        const VectorXd & joint_positions, const VectorXd & joint_velocities) const override
    {{
        check(joint_positions);
        check(joint_velocities);
        double bias[JOINTS], gravity[JOINTS];
        {_call(code, "bias", q, dq, "bias")}
        {_call(code, "gravity", q, "gravity")}
        for (std::size_t k = 0; k < JOINTS; ++k) {{
            bias[k] -= gravity[k];
        }}
        return vector_of(bias);
    }}

    VectorXd getGravityVector(const VectorXd & joint_positions) const override
    {{
        check(joint_positions);
        double tau[JOINTS];
        {_call(code, "gravity", q, "tau")}
        return vector_of(tau);
    }}

    VectorXd getFrictionVector(const VectorXd & joint_velocities) const override
    {{
        check(joint_velocities);
{_friction(code, dq)}
    }}

    /* All terms of the model, friction included. */
    VectorXd getTorques(
        const VectorXd & joint_positions, const VectorXd & joint_velocities,
        const VectorXd & joint_accelerations) const override
    {{
        check(joint_positions);
        check(joint_velocities);
        check(joint_accelerations);
        double tau[JOINTS];
        {_call(code, "torque", q, dq, ddq, "tau")}
        return vector_of(tau);
    }}
}};

}}  // namespace {package}

PLUGINLIB_EXPORT_CLASS({package}::Solver, inverse_dynamics_solver::InverseDynamicsSolver)
"""


def _needs_position(function: Function) -> bool:
    """Whether a function of `q` and `dq` reads positions."""
    place = len(function.program.inputs) - 1
    return any(
        step.operation == "input" and step.arguments[0] < place
        for step in function.program.pruned().steps
    )


def _friction(code: CCode, dq: str) -> str:
    if _needs_position(code.functions["friction"][0]):
        return """\
        throw std::logic_error(
            "friction of this model depends on positions too: it is part of getTorques only");"""
    arrays = ", ".join(["zero", *(["zero"] if code.passive else []), dq])
    size = max(code.controller.model.robot.n, code.passive)
    return f"""\
        const double zero[{size}] = {{}};  // friction does not depend on positions
        double tau[JOINTS];
        {code.name}_friction({arrays}, tau);
        return vector_of(tau);"""


def _node(package: str) -> str:
    return f"""\
/* Node: trajectories on topic 'trajectory' go to topic 'trajectory_with_efforts', with efforts. */
#include <rclcpp/rclcpp.hpp>
#include <trajectory_msgs/msg/joint_trajectory.hpp>

#include <exception>
#include <memory>

#include "efforts.hpp"

using trajectory_msgs::msg::JointTrajectory;

int main(int argc, char ** argv)
{{
    rclcpp::init(argc, argv);
    auto node = std::make_shared<rclcpp::Node>("fill_efforts");
    auto publisher = node->create_publisher<JointTrajectory>("trajectory_with_efforts", 10);
    auto subscription = node->create_subscription<JointTrajectory>(
        "trajectory", 10, [node, publisher](JointTrajectory::ConstSharedPtr message) {{
            JointTrajectory trajectory = *message;
            try {{
                {package}::fill_efforts(trajectory);
            }} catch (const std::exception & error) {{
                RCLCPP_ERROR(node->get_logger(), "trajectory not published: %s", error.what());
                return;
            }}
            publisher->publish(trajectory);
        }});
    rclcpp::spin(node);
    rclcpp::shutdown();
    return 0;
}}
"""


def _readme(code: CCode, package: str) -> str:
    robot = code.controller.model.robot
    chains = (
        "- Closed chains: positions are those of the driven joints. Every call finds the passive\n"
        "  joints from the reference configuration; where the chains do not close it throws\n"
        "  `std::domain_error`.\n"
    )
    positional = (
        "- Friction of this model depends on positions too, which are no argument of\n"
        "  `getFrictionVector`: that throws `std::logic_error`.\n"
    )
    return f"""\
# {package}

Identified inverse dynamics of {commented(robot.name)} for ROS 2: a plugin of
[inverse_dynamics_solver](https://docs.ros.org/en/jazzy/p/inverse_dynamics_solver) (Humble, Jazzy),
class `{package}/Solver`,
and a node that fills the field `effort` of trajectories.

**Not built with ROS 2 where it was written.** `{code.name}_test` compares the C code with Python;
the tests of steelyard compile such C++ files against declarations of the interfaces only.
License and maintainer in `package.xml` are placeholders: change them.

    colcon build --packages-select {package}
    colcon test --packages-select {package}
    ros2 run {package} fill_efforts

- `getTorques` has all terms of the model, friction included; `getFrictionVector` is friction
  alone. `initialize` reads nothing: the model is part of the code.
- `fill_efforts` reads `trajectory_msgs/JointTrajectory` from topic `trajectory` and publishes it
  with efforts on `trajectory_with_efforts`. Joints may be in any order, but all have to be there,
  with position, velocity and acceleration at every point; other trajectories are refused with an
  error in the log.
{chains if code.passive else ""}\
{positional if _needs_position(code.functions["friction"][0]) else ""}\

Arrays of the plugin are in the order of the joints (number, name, units of position and effort):

{joint_list(robot.coordinates)}
"""

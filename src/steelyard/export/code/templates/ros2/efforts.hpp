/* Efforts of trajectories by [[ name ]].c. */
#ifndef [[ package | upper ]]_EFFORTS_HPP
#define [[ package | upper ]]_EFFORTS_HPP

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "[[ name ]].h"

namespace [[ package ]]
{

constexpr std::size_t JOINTS = [[ n ]];

[% if passive %]
/* Positions of the passive joints at q. */
struct Chains {
    double passive[[[ passive ]]];
    explicit Chains(const double *q)
    {
        if (!([[ name ]]_follow(q, passive) < [[ largest_gap ]])) {
            throw std::domain_error("the chains of the robot do not close at these positions");
        }
    }
};

[% endif %]
/* Names of the joints in the order of [[ name ]].c. */
inline const std::array<std::string, JOINTS> & joint_names()
{
    static const std::array<std::string, JOINTS> names{{
        [[ literals | join(",\n        ") ]]
    }};
    return names;
}

/* Fill the efforts of all points; joints may be in any order.
   Throws std::invalid_argument where a joint, position, velocity or acceleration is missing. */
template <class Trajectory>
void fill_efforts(Trajectory & trajectory)
{
    const auto & given = trajectory.joint_names;
    std::array<std::size_t, JOINTS> places{};
    for (std::size_t k = 0; k < JOINTS; ++k) {
        const auto found = std::find(given.begin(), given.end(), joint_names()[k]);
        if (found == given.end()) {
            throw std::invalid_argument("joint '" + joint_names()[k] + "' is missing");
        }
        places[k] = static_cast<std::size_t>(found - given.begin());
    }
    if (given.size() != JOINTS) {
        throw std::invalid_argument(
            "the trajectory has " + std::to_string(given.size()) + " joints, the model " +
            std::to_string(JOINTS));
    }
    std::vector<std::vector<double>> efforts;
    for (const auto & point : trajectory.points) {
        if (point.positions.size() != JOINTS || point.velocities.size() != JOINTS ||
            point.accelerations.size() != JOINTS) {
            throw std::invalid_argument(
                "point " + std::to_string(efforts.size()) +
                " needs a position, a velocity and an acceleration of every joint");
        }
        double q[JOINTS], dq[JOINTS], ddq[JOINTS], tau[JOINTS];
        for (std::size_t k = 0; k < JOINTS; ++k) {
            q[k] = point.positions[places[k]];
            dq[k] = point.velocities[places[k]];
            ddq[k] = point.accelerations[places[k]];
        }
        [[ call("torque", "q", "dq", "ddq", "tau") ]]
        efforts.emplace_back(JOINTS);
        for (std::size_t k = 0; k < JOINTS; ++k) {
            efforts.back()[places[k]] = tau[k];
        }
    }
    for (std::size_t i = 0; i < efforts.size(); ++i) {
        trajectory.points[i].effort = efforts[i];
    }
}

}  // namespace [[ package ]]

#endif

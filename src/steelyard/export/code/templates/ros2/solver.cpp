/* Plugin of inverse_dynamics_solver around [[ name ]].c. */
#include <inverse_dynamics_solver/inverse_dynamics_solver.hpp>
#include <pluginlib/class_list_macros.hpp>

#include <stdexcept>
#include <string>

#include "efforts.hpp"

namespace [[ package ]]
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

static VectorXd vector_of(const double (&values)[JOINTS])
{
    VectorXd found(static_cast<int>(JOINTS));
    std::copy(values, values + JOINTS, found.data());
    return found;
}

static void check(const VectorXd & values)
{
    if (static_cast<std::size_t>(values.size()) != JOINTS) {
        throw std::invalid_argument(
            std::to_string(values.size()) + " values of " + std::to_string(JOINTS) + " joints");
    }
}

class Solver : public inverse_dynamics_solver::InverseDynamicsSolver
{
public:
    /* The model is part of the code: no parameter and no robot description is read. */
    void initialize(
        rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr, const std::string &,
        const std::string &) override
    {
    }

    MatrixXd getInertiaMatrix(const VectorXd & joint_positions) const override
    {
        check(joint_positions);
        MatrixXd matrix(static_cast<int>(JOINTS), static_cast<int>(JOINTS));
        /* symmetric: rows are columns */
        [[ call("mass", q, "matrix.data()") ]]
        return matrix;
    }

    VectorXd getCoriolisVector(
        const VectorXd & joint_positions, const VectorXd & joint_velocities) const override
    {
        check(joint_positions);
        check(joint_velocities);
        double bias[JOINTS], gravity[JOINTS];
        [[ call("bias", q, dq, "bias") ]]
        [[ call("gravity", q, "gravity") ]]
        for (std::size_t k = 0; k < JOINTS; ++k) {
            bias[k] -= gravity[k];
        }
        return vector_of(bias);
    }

    VectorXd getGravityVector(const VectorXd & joint_positions) const override
    {
        check(joint_positions);
        double tau[JOINTS];
        [[ call("gravity", q, "tau") ]]
        return vector_of(tau);
    }

    VectorXd getFrictionVector(const VectorXd & joint_velocities) const override
    {
        check(joint_velocities);
[% if positional %]
        throw std::logic_error(
            "friction of this model depends on positions too: it is part of getTorques only");
[% else %]
        const double zero[ [[- zeros -]] ] = {};  // friction does not depend on positions
        double tau[JOINTS];
        [[ name ]]_friction(zero, [% if passive %]zero, [% endif %][[ dq ]], tau);
        return vector_of(tau);
[% endif %]
    }

    /* All terms of the model, friction included. */
    VectorXd getTorques(
        const VectorXd & joint_positions, const VectorXd & joint_velocities,
        const VectorXd & joint_accelerations) const override
    {
        check(joint_positions);
        check(joint_velocities);
        check(joint_accelerations);
        double tau[JOINTS];
        [[ call("torque", q, dq, ddq, "tau") ]]
        return vector_of(tau);
    }
};

}  // namespace [[ package ]]

PLUGINLIB_EXPORT_CLASS([[ package ]]::Solver, inverse_dynamics_solver::InverseDynamicsSolver)

// Declarations of inverse_dynamics_solver (Humble, Jazzy), with as much of Eigen as plugins use.
#pragma once
#include <algorithm>
#include <memory>
#include <string>
#include <vector>

namespace Eigen
{
class MatrixXd
{
public:
    MatrixXd(int rows, int columns) : values_(static_cast<std::size_t>(rows * columns)) {}
    double * data() { return values_.data(); }
    const double * data() const { return values_.data(); }
    long size() const { return static_cast<long>(values_.size()); }

private:
    std::vector<double> values_;
};
class VectorXd : public MatrixXd
{
public:
    explicit VectorXd(int size) : MatrixXd(size, 1) {}
};
}  // namespace Eigen

namespace rclcpp::node_interfaces
{
struct NodeParametersInterface
{
    using ConstSharedPtr = std::shared_ptr<const NodeParametersInterface>;
};
}  // namespace rclcpp::node_interfaces

namespace inverse_dynamics_solver
{
class InverseDynamicsSolver
{
public:
    virtual ~InverseDynamicsSolver() {}
    virtual void initialize(
        rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr parameters = nullptr,
        const std::string & param_namespace = "", const std::string & robot_description = "") = 0;
    virtual Eigen::MatrixXd getInertiaMatrix(const Eigen::VectorXd & q) const = 0;
    virtual Eigen::VectorXd getCoriolisVector(
        const Eigen::VectorXd & q, const Eigen::VectorXd & dq) const = 0;
    virtual Eigen::VectorXd getGravityVector(const Eigen::VectorXd & q) const = 0;
    virtual Eigen::VectorXd getFrictionVector(const Eigen::VectorXd & dq) const = 0;
    virtual Eigen::VectorXd getTorques(
        const Eigen::VectorXd & q, const Eigen::VectorXd & dq,
        const Eigen::VectorXd & ddq) const = 0;

protected:
    InverseDynamicsSolver() {}
};
}  // namespace inverse_dynamics_solver

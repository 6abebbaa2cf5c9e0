/* Node: trajectories on topic 'trajectory' go to topic 'trajectory_with_efforts', with efforts. */
#include <rclcpp/rclcpp.hpp>
#include <trajectory_msgs/msg/joint_trajectory.hpp>

#include <exception>
#include <memory>

#include "efforts.hpp"

using trajectory_msgs::msg::JointTrajectory;

int main(int argc, char ** argv)
{
    rclcpp::init(argc, argv);
    auto node = std::make_shared<rclcpp::Node>("fill_efforts");
    auto publisher = node->create_publisher<JointTrajectory>("trajectory_with_efforts", 10);
    auto subscription = node->create_subscription<JointTrajectory>(
        "trajectory", 10, [node, publisher](JointTrajectory::ConstSharedPtr message) {
            JointTrajectory trajectory = *message;
            try {
                [[ package ]]::fill_efforts(trajectory);
            } catch (const std::exception & error) {
                RCLCPP_ERROR(node->get_logger(), "trajectory not published: %s", error.what());
                return;
            }
            publisher->publish(trajectory);
        });
    rclcpp::spin(node);
    rclcpp::shutdown();
    return 0;
}

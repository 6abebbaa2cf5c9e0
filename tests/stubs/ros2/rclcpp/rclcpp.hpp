// A node whose spin passes trajectories from standard input to its subscription: the number of
// joints and points, the names, then per point positions, velocities, accelerations. What it
// publishes goes to standard output, what it logs to standard error.
#pragma once
#include <cstdio>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <trajectory_msgs/msg/joint_trajectory.hpp>

#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::fprintf(stderr, __VA_ARGS__))

namespace rclcpp
{
using Message = trajectory_msgs::msg::JointTrajectory;

template <class T>
struct Publisher
{
    void publish(const T & trajectory)
    {
        std::cout.precision(17);
        for (const auto & point : trajectory.points) {
            for (double x : point.effort) {
                std::cout << x << "\n";
            }
        }
    }
};

class Node
{
public:
    explicit Node(const std::string &) {}
    int get_logger() const { return 0; }
    template <class T>
    std::shared_ptr<Publisher<T>> create_publisher(const std::string &, int)
    {
        return std::make_shared<Publisher<T>>();
    }
    template <class T>
    std::shared_ptr<int> create_subscription(
        const std::string &, int, std::function<void(typename T::ConstSharedPtr)> call)
    {
        call_ = call;
        return nullptr;
    }
    std::function<void(Message::ConstSharedPtr)> call_;
};

inline void init(int, char **) {}
inline void shutdown() {}
inline void spin(const std::shared_ptr<Node> & node)
{
    std::size_t joints, points;
    std::cin >> joints >> points;
    auto message = std::make_shared<Message>();
    message->joint_names.resize(joints);
    message->points.resize(points);
    for (auto & name : message->joint_names) {
        std::cin >> name;
    }
    for (auto & point : message->points) {
        for (auto * values : {&point.positions, &point.velocities, &point.accelerations}) {
            values->resize(joints);
            for (double & x : *values) {
                std::cin >> x;
            }
        }
    }
    node->call_(message);
}
}  // namespace rclcpp

"""External torque and wrench: what pushes a robot, from the torque that its model leaves over."""

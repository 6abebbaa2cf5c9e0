"""A virtual robot: physics, controller and sensors with their faults."""

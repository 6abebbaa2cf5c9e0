"""Models as code for controllers: C99, Python, FMU, ROS 2, Simulink."""

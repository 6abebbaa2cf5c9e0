"""Identified models as code for controllers: C99, Python with NumPy alone, FMU, ROS 2, Simulink."""

"""External torque and wrench: observer and regression."""

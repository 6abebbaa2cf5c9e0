"""External torque, contact and payload on samples as they arrive."""

"""A robot with its causes of torque: equations, laws, quantities, `Model`."""

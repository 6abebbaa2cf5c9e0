"""What a cause of torque is, and the coordinates that it acts along."""

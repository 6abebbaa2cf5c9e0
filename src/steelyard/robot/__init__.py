"""What the robot is: bodies, joints, inertias, and the files they come from."""

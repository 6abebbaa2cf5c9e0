"""Design of exciting motion, from the robot file to files for controllers."""

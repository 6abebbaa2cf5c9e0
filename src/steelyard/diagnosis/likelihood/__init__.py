"""How well an interpretation of a log agrees with what is known of the robot."""

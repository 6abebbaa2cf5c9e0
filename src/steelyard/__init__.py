"""steelyard: weigh a robot from its motion and its torque."""

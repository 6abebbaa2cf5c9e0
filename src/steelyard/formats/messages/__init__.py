"""Files of recorded messages: MCAP and ROS bags."""

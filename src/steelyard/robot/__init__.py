"""What the robot is: bodies, joints, inertias, and the files they come from."""

from steelyard.robot.from_mechanism import reduced as reduced
from steelyard.robot.inertia import Inertia as Inertia
from steelyard.robot.mechanism import Mechanism as Mechanism
from steelyard.robot.robot import Body as Body
from steelyard.robot.robot import Coordinate as Coordinate
from steelyard.robot.robot import Limits as Limits
from steelyard.robot.robot import Robot as Robot

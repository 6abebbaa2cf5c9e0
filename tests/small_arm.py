"""An arm of two joints with two logs and its identified model, for the Python interface."""

from pathlib import Path
from shutil import copyfile, rmtree

from proofs.support import servo_arm

import steelyard
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import write_motion

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.15 0 0"/><mass value="1.5"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint1" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="80"/></joint>
  <joint name="joint2" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="40"/></joint>
</robot>
"""


def made(place: Path) -> None:
    """Write all of it to a folder; the logs are of different motions."""
    (place / "arm.urdf").write_text(URDF)
    short = "[excitation.motion]\nperiod = 4.0\nharmonics = 4\n"
    (place / "arm.toml").write_text(f'[robot]\nurdf = "arm.urdf"\n{short}')
    robot, drawn = place / "arm.toml", place / "drawn.json"
    arm = steelyard.load_robot(robot).robot
    write_motion(drawn, random_fourier(arm, seed=2, period=10.0), arm)
    steelyard.simulate(robot, place / "fit", seed=1)
    steelyard.simulate(robot, place / "other", drawn, seed=1)
    for name in ("fit", "other"):
        copyfile(place / name / "log.csv", place / f"{name}.csv")
    steelyard.identify(robot, place / "fit.csv").save(place / "arm-model")
    for number, (unit, day) in enumerate((u, d) for u in ("one", "two") for d in ("day1", "day2")):
        log = place / "fleet-logs" / unit / f"{day}.csv"
        log.parent.mkdir(parents=True, exist_ok=True)
        steelyard.simulate(robot, place / "again", seed=10 + number)
        (place / "again" / "log.csv").rename(log)
        rmtree(place / "again")
    servos = servo_arm.made(place, seconds=40.0)
    known = "position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n"
    known += '[actuator]\nlaw = "position_pd"\n'
    servos.rename(place / "servo.toml").write_text(servo_arm.ROBOT_FILE + known)
    for log, name in (("servo_fit.csv", "servo-model"), ("servo_other.csv", "other-servo-model")):
        steelyard.identify_actuators(place / "servo.toml", place / log).save(place / name)

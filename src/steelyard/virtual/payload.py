"""A load that the virtual robot carries for a while."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import Robot

_STEEL = 7800.0
"""Density [kg/m³]."""


@dataclass(frozen=True)
class Payload:
    """A body that is fixed to a frame of the robot between two times.

    Attributes:
        inertia: Its ten numbers, about the frame's origin and along its axes.
        frame: Name of a frame or link of the robot.
        attach: When it is taken [s], from the start of the log.
        release: When it is let go [s].
    """

    inertia: Inertia
    frame: str
    attach: float = 0.0
    release: float = float("inf")

    def __post_init__(self) -> None:
        flaw = self.inertia.flaw()
        if flaw is not None or not 0.0 <= self.attach < self.release:
            raise ModelError(
                f"the payload is not physically consistent: {flaw}"
                if flaw is not None
                else f"the payload is attached at {self.attach:g} s, released at "
                f"{self.release:g} s",
                where=f"payload on '{self.frame}'",
                fix="give mass properties of a real body, and times 0 <= attach < release",
            )

    @classmethod
    def ball(
        cls, mass: float, frame: str, attach: float = 0.0, release: float = float("inf")
    ) -> "Payload":
        """A steel ball of a mass [kg] around the frame's origin."""
        radius = (mass / (_STEEL * 4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)
        moments = 0.4 * mass * radius**2 * np.eye(3)
        return cls(Inertia.about_com(mass, np.zeros(3), moments), frame, attach, release)

    def carried(self, t: Array) -> Array:
        """Whether it is carried at times `t`, as booleans."""
        return np.asarray((t >= self.attach) & (t < self.release))

    def added(self, robot: Robot, inertial: Array) -> Array:
        """The bodies' ten numbers, `(n_bodies, 10)`, with the payload on them.

        Raises:
            ModelError: The robot has no frame of that name, or it does not move.
        """
        frames = {f.name: (f.body, f.rotation, f.position) for f in robot.frames}
        own = {b.name: (k, np.eye(3), np.zeros(3)) for k, b in enumerate(robot.bodies)}
        places = {**own, **frames}
        body, rotation, position = places.get(self.frame, (-1, np.eye(3), np.zeros(3)))
        if body < 0:
            moving = [name for name, place in places.items() if place[0] >= 0]
            raise ModelError(
                f"the payload hangs on '{self.frame}', which is no moving frame of the robot",
                where=f"robot '{robot.name}'",
                fix=f"use one of {', '.join(moving)}",
            )
        loaded = inertial.copy()
        loaded[body] += self.inertia.moved(rotation, position).ten
        return loaded

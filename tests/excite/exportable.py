"""Robots and motions whose formulas stand here, to be exported."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.motion import Motion
from steelyard.excite.trajectories.exact_trajectories import (
    ExactTrajectory,
    SlowedMotion,
)
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.robot import Body, Coordinate, JointKind, Robot

TOLERANCE = 1e-6
"""How closely exported motions are followed [rad; m]."""


def arm(count: int = 6, *prismatic: int) -> Robot:
    """A chain of joints."""
    kinds: list[JointKind] = ["prismatic" if k in prismatic else "revolute" for k in range(count)]
    joints = tuple(Coordinate(f"joint {k + 1}", kind) for k, kind in enumerate(kinds))
    bodies = tuple(
        Body(c.name, c.name, c.kind, k - 1, np.eye(3), np.zeros(3), np.array([0.0, 0, 1]), k)
        for k, c in enumerate(joints)
    )
    return Robot("arm -- of é", bodies, joints)


@dataclass(frozen=True)
class Swings:
    """Joint `j` swings to `j + 1` times 0.06 and back, from rest to rest but pulling at once."""

    joints: int = 6
    swings: int = 3
    duration: float = 4.7103

    @property
    def breaks(self) -> np.ndarray:
        return np.array([0.0, self.duration])

    def derivative(self, t: Any, order: int) -> np.ndarray:
        rate = 2.0 * np.pi * self.swings / self.duration
        phase = rate * np.asarray(t, dtype=float)[:, None]
        wave = -np.cos(phase + order * np.pi / 2.0) * rate**order + (order == 0)
        return 0.03 * wave * np.arange(1, self.joints + 1) * (-1) ** np.arange(self.joints)

    def extremes(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        dense = self.derivative(np.linspace(0.0, self.duration, 1001), order)
        return dense.min(axis=0) * 1.01, dense.max(axis=0) * 1.01

    def sample(self, t: Any) -> Motion:
        return Motion(t, *(self.derivative(t, order) for order in range(3)))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "swings"}


@dataclass(frozen=True)
class Jumps(Swings):
    """Constant accelerations, one after another, which jump in between: +a, -a, -a, +a."""

    @property
    def breaks(self) -> np.ndarray:
        return np.array([0.0, 0.31, 0.62, 1.0, 1.1, 1.2]) / 1.2 * self.duration

    def derivative(self, t: Any, order: int) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        a = np.array([1.0, -1.0, 0.0, 2.0, -2.0])
        edges = self.breaks
        width = np.diff(edges)
        speed = np.concatenate([[0.0], np.cumsum(a * width)])
        place = np.concatenate([[0.0], np.cumsum(speed[:-1] * width + a * width**2 / 2.0)])
        k = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(a) - 1)
        s = t - edges[k]
        values = (
            place[k] + speed[k] * s + a[k] * s**2 / 2.0,
            speed[k] + a[k] * s,
            a[k],
            np.zeros_like(t),
        )
        return values[order][:, None] * np.linspace(0.5, 1.0, self.joints)


def motions(robot: Robot) -> dict[str, ExactTrajectory]:
    """By name; their durations fit no controller's step."""
    quick = Swings(robot.n, 9, 2.001)
    return {
        "fourier": random_fourier(robot, seed=3, period=3.1, periods=2),
        "swings": Swings(robot.n),
        "quick": quick,
        "slowed": SlowedMotion(quick, 0.6),
        "jumps": Jumps(robot.n),
    }


NAMES = ("fourier", "swings", "quick", "slowed", "jumps")

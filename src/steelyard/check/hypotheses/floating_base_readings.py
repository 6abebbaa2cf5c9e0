r"""How sensors of a floating base are read: mounting, clock, and which contact pushes how.

Six rows of the equations are those of the base, whose efforts are zero but for the contacts. So
what is known of the efforts beside what joints log is

$$ p = \sum_c s_c J_c^T \begin{bmatrix} R_c & 0 \\ 0 & R_c \end{bmatrix} F_c, $$

with the Jacobian $J_c$ of each contact's frame, its axes $R_c$ (or those of the world) in the base
link, the logged wrench $F_c$, and a factor $s_c$ that is 1 as declared.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.model.equations.frame_and_point_kinematics import FrameKinematics, frame_kinematics
from steelyard.robot.file.signals import BaseSignals
from steelyard.robot.robot import BASE_COORDINATES, Robot
from steelyard.runs.floating_base import base_motion

BASE_ROWS = len(BASE_COORDINATES)


@dataclass(frozen=True, eq=False)
class BaseSamples:
    """Samples of contacts and orientation, behind the low-pass of an excerpt."""

    wrenches: Array  # force and moment of each contact as logged, `(contacts, 6, B)` [N, Nm]
    axes: Array | None  # of the base link in the world as declared, `(B, 3, 3)`, if logged

    def thinned(self, step: int) -> "BaseSamples":
        """Every which sample."""
        axes = None if self.axes is None else self.axes[::step]
        return BaseSamples(self.wrenches[..., ::step], axes)


@dataclass(frozen=True, eq=False)
class BaseReading:
    """How the sensors of a floating base are read."""

    turn: Array  # of the inertial sensor's axes from the declared ones, in the base link, `(3, 3)`
    place: Array  # of the sensor on the base link, shape `(3,)` [m]
    delay: float  # of the sensor against positions [s]
    contacts: tuple[int, ...]  # number of the declared contact whose columns each contact has
    factors: Array  # on each contact's wrench, sign included, shape `(contacts,)`
    in_world: tuple[bool, ...]  # whether each contact is along the world's axes, not its frame's
    # of the accelerometer along the base link's axes, beside a declared one, shape `(3,)` [m/s²]
    bias: Array = field(default_factory=lambda: np.zeros(3))

    def changed(self, **fields: Any) -> "BaseReading":
        """The same with some of its attributes replaced."""
        return replace(self, **fields)

    @property
    def key(self) -> tuple[Any, ...]:
        """What makes it another one."""
        return (
            np.round(self.turn, 4).tobytes(),
            np.round(self.place, 4).tobytes(),
            round(self.delay, 4),
            np.round(self.bias, 5).tobytes(),
            self.contacts,
            np.round(self.factors, 4).tobytes(),
            self.in_world,
        )


@dataclass(frozen=True, eq=False)
class FloatingBase:
    """The base of a robot, and the frames that contacts push on."""

    signals: BaseSignals
    robot: Robot

    @property
    def declared(self) -> BaseReading:
        """How the robot file reads its sensors."""
        count = len(self.signals.contacts)
        in_world = tuple(contact.in_world for contact in self.signals.contacts)
        return BaseReading(
            np.eye(3),
            np.array(self.signals.place),
            self.signals.delay,
            tuple(range(count)),
            np.ones(count),
            in_world,
        )

    def motion(self, reading: BaseReading, channels: tuple[Array, Array, Array]) -> Array:
        """Rows of the base in `q`, `dq` and `ddq`, `(3, 6, B)`, of channels and derivatives."""
        at_sensor = replace(self.signals, place=(0.0, 0.0, 0.0))
        velocity, acceleration = base_motion(at_sensor, *channels)
        rows = np.stack((velocity, acceleration)).reshape(2, 2, 3, -1)
        (v, omega), (a, alpha) = reading.turn @ rows
        a = a - reading.bias[:, None]
        place = np.reshape(reading.place, (3, 1))
        swing = _cross(omega, place)
        a = a - _cross(alpha, place) - _cross(omega, swing)
        v = v - swing if self.signals.tracked else v
        moved = np.concatenate((v, omega)), np.concatenate((a, alpha))
        return np.stack((np.zeros_like(moved[0]), *moved))

    def pushed(self, reading: BaseReading, q: Array, samples: BaseSamples) -> Array:
        """Efforts `(n, B)` of the contacts at positions `(n, B)` [N; Nm]."""
        found = np.zeros_like(q)
        for _, jacobian, wrench in self._wrenches(reading, q, samples):
            found += np.einsum("bki,bk->ib", jacobian, wrench)
        return found

    def levers(self, reading: BaseReading, q: Array, samples: BaseSamples) -> Array:
        """Efforts of the contacts per metre by which each is elsewhere, `(n, B, 3 contacts)`.

        It is moved along the axes of its frame.
        """
        moments = (
            np.einsum("bin,bik->nbk", jacobian[:, 3:], np.cross(axes, wrench[:, :3, None], axis=1))
            for axes, jacobian, wrench in self._wrenches(reading, q, samples)
        )
        return np.concatenate([np.zeros((*q.shape, 0)), *moments], axis=-1)

    def _wrenches(
        self, reading: BaseReading, q: Array, samples: BaseSamples
    ) -> Iterator[tuple[Array, Array, Array]]:
        """Of each contact its axes `(B, 3, 3)`, Jacobian `(B, 6, n)` and wrench `(B, 6)`."""
        for number, kinematics in enumerate(self._frames):
            _, axes, jacobian = kinematics(q.T)
            turn = axes
            if reading.in_world[number] and samples.axes is not None:
                turn = reading.turn @ samples.axes.transpose(0, 2, 1)
            logged = samples.wrenches[reading.contacts[number]].reshape(2, 3, -1)
            wrench = np.einsum("bij,kjb->bki", turn, logged).reshape(-1, 6)
            yield axes, jacobian, reading.factors[number] * wrench

    @cached_property
    def _frames(self) -> Sequence[FrameKinematics]:
        return [frame_kinematics(self.robot, c.frame) for c in self.signals.contacts]


def _cross(a: Array, b: Array) -> Array:
    return np.cross(a, np.broadcast_to(b, a.shape), axis=0)


def orthonormal(axes: Array) -> Array:
    """The rotations nearest to matrices `(N, 3, 3)`."""
    u, _, v = np.linalg.svd(axes)
    sign = np.sign(np.linalg.det(u @ v))
    u[..., -1] *= sign[:, None]
    return np.asarray(u @ v)


def right_angles() -> Iterable[Array]:
    """The 24 rotations that turn axes into axes."""
    from itertools import permutations, product

    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.diag(signs)[list(order)]
            if np.linalg.det(turn) > 0.0:
                yield turn

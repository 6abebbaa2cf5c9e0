"""What is known of a robot beforehand: an identified model, or else its nominal bodies."""

from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.estimation.payload.load_case import carrier
from steelyard.model import Model, ValuedModel
from steelyard.motion import Motion
from steelyard.parameters import Parameters
from steelyard.robot.inertia import INERTIAL_NAMES
from steelyard.robot.robot import Robot
from steelyard.terms.laws.rigid_body import RigidBody

AXES = np.eye(3)


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Predicts what a robot's joints need, friction left out.

    Attributes:
        steady: Bodies, rotors and springs with their values.
        whole: The same with friction; `None` if friction is not known.
        sigma: Standard deviation of the reference's own residuals, joint efforts, shape `(n,)`.
    """

    steady: ValuedModel
    whole: ValuedModel | None = None
    sigma: Array | None = None
    _turned: dict[bytes, ValuedModel] = field(default_factory=dict)

    @property
    def robot(self) -> Robot:
        """The robot, with the gravity that the values belong to."""
        return self.steady.model.robot

    @property
    def identified(self) -> bool:
        """Whether it comes from measurements of this robot."""
        return self.whole is not None

    def torque(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """Joint efforts under any gravity, shape `(n, N)`; NaN where the states are impossible."""
        if np.allclose(gravity, self.robot.gravity):
            return self._of(self.steady, q, dq, ddq)
        still = np.zeros_like(q)
        free = self.under(np.zeros(3))
        result = self._of(free, q, dq, ddq)
        for axis, part in zip(AXES, gravity, strict=True):
            if part != 0.0:
                pull = self._of(self.under(axis), q, still, still)
                result = result + part * (pull - self._of(free, q, still, still))
        return result

    def pulls(self, q: Array) -> Array:
        """Joint efforts that hold against gravity 1 m/s² along x, y and z, shape `(3, n, N)`."""
        still = np.zeros_like(q)
        rest = self._of(self.under(np.zeros(3)), q, still, still)
        return np.array([self._of(self.under(axis), q, still, still) - rest for axis in AXES])

    def friction(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Friction and offset of the reference along a motion, shape `(n, N)`."""
        if self.whole is None:
            return np.zeros_like(q)
        return self._of(self.whole, q, dq, ddq) - self._of(self.steady, q, dq, ddq)

    def payload(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """Joint efforts per unit of each of the payload's ten numbers, shape `(10, n, N)`.

        In the frame of the last body.
        """
        body = self.robot.bodies[carrier(self.robot).body].name
        bare = Model(self.robot.changed(gravity=np.asarray(gravity)), (RigidBody(),))
        found = []
        for name in INERTIAL_NAMES:
            column = f"{name}.{body}"
            one = Parameters([column], [bare.units[bare.names.index(column)]], [1.0])
            found.append(self._of(bare.at(one), q, dq, ddq))
        return np.array(found)

    def under(self, gravity: Array) -> ValuedModel:
        """The bodies, rotors and springs under another gravity [m/s²], shape `(3,)`."""
        key = np.asarray(gravity, dtype=np.float64).tobytes()
        if key not in self._turned:
            robot = self.robot.changed(gravity=np.asarray(gravity))
            model = replace(self.steady.model, robot=robot)
            self._turned[key] = ValuedModel(model, self.steady.values)
        return self._turned[key]

    def _of(self, valued: ValuedModel, q: Array, dq: Array, ddq: Array) -> Array:
        try:
            motion = Motion(np.arange(q.shape[1], dtype=np.float64), q.T, dq.T, ddq.T)
            return valued.torque(motion).T
        except (DataError, ValueError):
            return np.full(q.shape, np.nan)


def knowledge_of(reference: IdentifiedModel | None, robot: Robot) -> Knowledge | None:
    """What is known: the reference, or the nominal bodies; `None` where these are not given."""
    if reference is None:
        nominal = Model(robot, (RigidBody(),)).prior
        return None if nominal is None else Knowledge(nominal)
    model = reference.model
    terms = tuple(term for term in model.terms if not term.drifts())
    steady = Model(model.robot, terms)
    known = reference.estimate.parameters.as_dict()
    values = [known.get(name, 0.0) for name in steady.names]
    return Knowledge(
        ValuedModel(steady, Parameters(steady.names, steady.units, values)),
        reference.valued,
        np.asarray(reference.estimate.sigma),
    )

"""Joint efforts that a robot is known to need: under any gravity, by payloads, and of friction."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.robot import Robot

AtStates = Callable[[ValuedModel, Array, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class EffortPredictor:
    """Predicts what a robot's joints need, friction left out."""

    steady: ValuedModel  # bodies, rotors and springs with their values
    whole: ValuedModel | None = None  # the same with friction; `None` if friction is not known
    sigma: Array | None = None  # std of the reference's residuals, joint efforts, shape `(n,)`
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
        return self.under_any(gravity, self._of, q, dq, ddq)

    def under_any(self, gravity: Array, of: AtStates, q: Array, dq: Array, ddq: Array) -> Array:
        """What is linear in gravity, under another one than the robot's put together from four."""
        if np.allclose(gravity, self.robot.gravity):
            return of(self.steady, q, dq, ddq)
        still, free = np.zeros_like(q), self.under(np.zeros(3))
        result, rest = of(free, q, dq, ddq), of(free, q, still, still)
        for axis in np.flatnonzero(gravity):
            turned = self.under(np.eye(3)[axis])
            result = result + gravity[axis] * (of(turned, q, still, still) - rest)
        return result

    def pulls(self, q: Array) -> Array:
        """Joint efforts that hold against gravity 1 m/s² along x, y and z, shape `(3, n, N)`."""
        still = np.zeros_like(q)
        rest = self._of(self.under(np.zeros(3)), q, still, still)
        return np.array([self._of(self.under(x), q, still, still) - rest for x in np.eye(3)])

    def friction(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Friction and offset of the reference along a motion, shape `(n, N)`."""
        if self.whole is None:
            return np.zeros_like(q)
        return self._of(self.whole, q, dq, ddq) - self._of(self.steady, q, dq, ddq)

    def payload(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """Joint efforts per unit of a payload's ten numbers in the last body's frame."""
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


def effort_predictor(reference: IdentifiedModel | None, robot: Robot) -> EffortPredictor | None:
    """What is known: the reference, or the nominal bodies; `None` where these are not given."""
    if reference is None:
        nominal = Model(robot, (RigidBody(),)).prior
        return None if nominal is None else EffortPredictor(nominal)
    model = reference.model
    steady = Model(model.robot, tuple(term for term in model.terms if not term.drifts()))
    known = reference.estimate.parameters.as_dict()
    values = [known.get(name, 0.0) for name in steady.names]
    return EffortPredictor(
        ValuedModel(steady, Parameters(steady.names, steady.units, values)),
        reference.valued,
        np.asarray(reference.estimate.sigma),
    )

r"""What a model with values computes: torque and its parts, inertia, momentum, motion of frames."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.model import torque_and_quantities as quantities
from steelyard.model.torque_and_quantities import Quantity
from steelyard.robot.robot import Frame, Robot

if TYPE_CHECKING:
    from steelyard.model.compiled_quantity import Stepper


class Dynamics(ABC):
    r"""Dynamics of a robot whose parameters have values, such as an identified model.

    $$\tau = M(q)\,\ddot q + b(q, \dot q) + \tau_f(q, \dot q) + \tau_s(q)$$

    with the inertia $M$ of bodies and rotors, their bias $b$ (Coriolis, centrifugal and gravity
    efforts), friction $\tau_f$ of joints and motors, and springs with offsets $\tau_s$. All efforts
    are those of the joints: motors' friction and rotors act through the gears. Of a closed chain
    the coordinates are the driven joints; passive joints follow them.

    Of a robot with a floating base the first six coordinates are its base's, see `Robot`.

    All arguments are one configuration of shape `(n,)`, or one a row, `(N, n)`, and results have a
    first axis of `N` then: positions `q` [rad; m], velocities `dq`, accelerations `ddq`, efforts
    `tau` [Nm; N]. Rows are consecutive samples: friction with memory starts at the first one, and
    closed chains are followed from row to row. `start()` computes one sample at a time.

    Example:
        >>> model = load_model("arm-model")  # or model_of(load_robot("arm.toml")).prior
        >>> q, dq, ddq = [0.3, 0.5], [1.0, -0.5], [2.0, 0.0]
        >>> inertial = model.mass_matrix(q) @ ddq + model.bias(q, dq)
        >>> rest = model.torque(q, dq, ddq) - inertial - model.friction(q, dq, ddq)
        >>> offsets = model.valued.values.as_dict()
        >>> bool(abs(rest[0] - offsets["offset.joint1"]) < 1e-9)
        True
    """

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """The robot."""

    @abstractmethod
    def evaluate(self, quantity: Quantity, *arguments: ArrayLike, t: Array | None = None) -> Array:
        """A quantity at its arguments.

        Args:
            quantity: What is computed.
            arguments: As `quantity.arguments` names them.
            t: Times of the samples, for messages, shape `(N,)` [s].

        Raises:
            DataError: An argument has another shape, is no finite number or lies beyond 1e5 rad;
                a loop cannot close; or the result is too large for numbers.
        """

    @abstractmethod
    def start(self) -> "Stepper":
        """Begin to evaluate sample by sample: `start().step(q, dq, ddq)`."""

    def torque(
        self, q: Motion | ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
    ) -> Array:
        """Joint efforts of all terms, shape of `q` [Nm; N].

        Of an identified model with estimated scales of the logged efforts, these are the efforts
        divided by the scales; `IdentifiedModel.effort` has them as logged.

        Args:
            q: Positions; or a `Motion`, which has all three. An `IdentifiedModel` warns of angles
                far beyond the joint limits, such as degrees.
            dq: Velocities.
            ddq: Accelerations.

        Example:
            >>> model = load_model("arm-model")
            >>> still = [0.0, 0.0]
            >>> motion = Motion([0.0], [[0.3, 0.5]], [still], [still])
            >>> bool((model.torque(motion)[0] == model.torque([0.3, 0.5], still, still)).all())
            True
        """
        return self._along(quantities.TORQUE, q, dq, ddq)

    def friction(
        self, q: Motion | ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
    ) -> Array:
        """Efforts of the friction laws, those of motors through the gears; shape of `q` [Nm; N].

        In the unit of `torque`: divided by estimated scales of the logged efforts, if any.

        Args:
            q: Positions; or a `Motion`, which has all three.
            dq: Velocities.
            ddq: Accelerations; only load-dependent friction knows them.

        Example:
            >>> model = load_model("arm-model")
            >>> still = [0.0, 0.0]
            >>> model.friction([0.3, 0.5], still, still).tolist()
            [0.0, 0.0]
        """
        return self._along(quantities.FRICTION, q, dq, ddq)

    def regressor(
        self, q: Motion | ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
    ) -> Array:
        r"""Efforts per unit of every standard parameter, $\tau = Y(q, \dot q, \ddot q)\,\theta$.

        Args:
            q: Positions; or a `Motion`, which has all three.
            dq: Velocities.
            ddq: Accelerations.

        Returns:
            Shape `(n, p)` or `(N, n, p)`, columns in the order of the model's `names`.

        Example:
            >>> model = load_model("arm-model")
            >>> q, dq, ddq = [0.3, 0.5], [1.0, -0.5], [2.0, 0.0]
            >>> predicted = model.regressor(q, dq, ddq) @ model.valued.values.values
            >>> bool(abs(predicted - model.torque(q, dq, ddq)).max() < 1e-9)
            True
        """
        return self._along(quantities.REGRESSOR, q, dq, ddq)

    def gravity(self, q: ArrayLike) -> Array:
        """Efforts that hold the bodies at rest against gravity, shape of `q` [Nm; N].

        Raises:
            ModelError: The base floats: they depend on its inclination.

        Example:
            >>> load_model("arm-model").gravity([0.3, 0.5]).shape
            (2,)
        """
        return self.evaluate(quantities.GRAVITY, q)

    def bias(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Coriolis, centrifugal and gravity efforts of the bodies, shape of `q` [Nm; N].

        Rotors have a part in it where a closed chain moves them.

        Example:
            >>> model, still = load_model("arm-model"), [0.0, 0.0]
            >>> bool((model.bias([0.3, 0.5], still) == model.gravity([0.3, 0.5])).all())
            True
        """
        return self.evaluate(quantities.BIAS, q, dq)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Inertia of bodies and rotors as the joints feel it, symmetric.

        Returns:
            Shape `(n, n)` or `(N, n, n)` [kg m²; kg m; kg].

        Example:
            >>> import numpy as np
            >>> mass = load_model("arm-model").mass_matrix([0.3, 0.5])
            >>> bool((np.linalg.eigvalsh(mass) > 0.0).all())
            True
        """
        return self.evaluate(quantities.MASS_MATRIX, q)

    def momentum(self, q: ArrayLike, dq: ArrayLike) -> Array:
        r"""Generalised momentum $p = M(q)\,\dot q$, shape of `q` [kg m²/s; kg m/s].

        Example:
            >>> model, q, dq = load_model("arm-model"), [0.3, 0.5], [1.0, -0.5]
            >>> bool(abs(model.momentum(q, dq) - model.mass_matrix(q) @ dq).max() < 1e-9)
            True
        """
        return self.evaluate(quantities.MOMENTUM, q, dq)

    def momentum_rate(self, q: ArrayLike, dq: ArrayLike) -> Array:
        r"""What changes the momentum without any effort, $C(q, \dot q)^T \dot q - g(q)$ [Nm; N].

        It is the derivative of the Lagrangian by the positions. With the efforts $\tau_a$ that act
        on bodies and rotors, such as motor torque minus friction plus outer forces,
        $\dot p = \tau_a + C^T \dot q - g$ [DeLuca2005]. No acceleration is needed.

        Raises:
            ModelError: The base floats: it depends on its inclination.

        Example:
            >>> model, q, still = load_model("arm-model"), [0.3, 0.5], [0.0, 0.0]
            >>> bool(abs(model.momentum_rate(q, still) + model.gravity(q)).max() < 1e-9)
            True
        """
        return self.evaluate(quantities.MOMENTUM_RATE, q, dq)

    def forward_dynamics(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> Array:
        r"""Accelerations under joint efforts, $M^{-1}(\tau - b - \tau_f - \tau_s)$.

        Returns:
            Shape of `q` [rad/s²; m/s²].

        Raises:
            DataError: The mass matrix is not positive definite at a posture.
            ModelError: Friction depends on the acceleration (load-dependent friction).

        Example:
            >>> model, q, dq, ddq = load_model("arm-model"), [0.3, 0.5], [1.0, -0.5], [2.0, 0.0]
            >>> found = model.forward_dynamics(q, dq, model.torque(q, dq, ddq))
            >>> bool(abs(found - ddq).max() < 1e-9)
            True
        """
        return self.evaluate(quantities.FORWARD_DYNAMICS, q, dq, tau)[..., :-1]

    def pose(self, q: ArrayLike, frame: str | Frame) -> tuple[Array, Array]:
        """Where a frame is in the base frame.

        Args:
            q: Positions.
            frame: Name of a link, also of one that is fixed to another; or a frame on any body.

        Returns:
            Its origin, shape `(3,)` or `(N, 3)` [m], and its axes, the columns of `(3, 3)` or
            `(N, 3, 3)`.

        Raises:
            ModelError: The robot has no frame of that name.

        Example:
            >>> position, axes = load_model("arm-model").pose([0.3, 0.5], "lower")
            >>> position.round(3).tolist()
            [0.382, 0.0, -0.118]
        """
        found = self.evaluate(quantities.frame_quantity(self.robot, frame), q)
        return found[..., :3], found[..., 3:12].reshape(*found.shape[:-1], 3, 3)

    def jacobian(self, q: ArrayLike, frame: str | Frame) -> Array:
        """Joint speeds to a frame's velocity, in the base frame's axes.

        Args:
            q: Positions.
            frame: As for `pose`.

        Returns:
            Shape `(6, n)` or `(N, 6, n)`: rows of the velocity of the frame's origin, then of the
            angular velocity. Its transpose maps a force and a moment about that origin to efforts.

        Raises:
            ModelError: The robot has no frame of that name.

        Example:
            >>> load_model("arm-model").jacobian([0.3, 0.5], "lower")[:3].round(3).tolist()
            [[-0.118, 0.0], [0.0, 0.0], [-0.382, 0.0]]
        """
        found = self.evaluate(quantities.frame_quantity(self.robot, frame), q)
        return found[..., 12:].reshape(*found.shape[:-1], 6, self.robot.n)

    def _along(
        self, quantity: Quantity, q: Motion | ArrayLike, dq: ArrayLike | None, ddq: ArrayLike | None
    ) -> Array:
        if isinstance(q, Motion) and dq is None and ddq is None:
            if q.n_joints != self.robot.n:
                raise DataError(
                    f"the motion has {q.n_joints} joints, the model {self.robot.n}",
                    where=f"model of '{self.robot.name}'",
                    fix=f"give columns for {', '.join(self.robot.joint_names)}",
                )
            return self.evaluate(quantity, q.q, q.dq, q.ddq, t=q.t)
        if isinstance(q, Motion) or dq is None or ddq is None:
            raise DataError(
                f"a {type(q).__name__} alone is no motion"
                if dq is None and ddq is None
                else "a motion is given in part",
                where=f"model of '{self.robot.name}'",
                fix="give steelyard.Motion(t, q, dq, ddq), or trajectory.sample(t), or q, dq, ddq",
            )
        return self.evaluate(quantity, q, dq, ddq)

r"""A frame's pose, Jacobian and drift, on open and closed chains, as machine code.

With the linear and the angular velocity $v = J \dot q$, the accelerations are
$a = J \ddot q + \dot J \dot q$; the drift is $\dot J \dot q$. Passive joints follow the independent
ones, so that $J$ and the drift are those of the independent joints alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.closed_chains import completed
from steelyard.kernel.equations.dynamics import JointState, Scalar
from steelyard.kernel.native.compiled import Code, compiled
from steelyard.kernel.program.program import Array as Input
from steelyard.kernel.program.program import Program
from steelyard.kernel.quantities.kinematics import frame_outputs
from steelyard.robot.json import robot_to_dict
from steelyard.robot.robot import Frame, Robot


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Kinematics of one frame up to accelerations.

    Attributes:
        robot: The robot.
        frame: The frame.
        code: Inputs `q`, positions of passive joints, `dq`; outputs as `frame_outputs`, then the
            drift.
    """

    robot: Robot
    frame: Frame
    code: Code

    def __call__(self, q: Array, passive: Array, dq: Array) -> tuple[Array, Array, Array, Array]:
        """At one sample.

        Args:
            q: Independent joints, shape `(n,)` [rad; m].
            passive: Passive joints, where the loops are closed, shape `(n_passive,)`.
            dq: Velocities of the independent joints, shape `(n,)`.

        Returns:
            Origin `(3,)` [m], axes `(3, 3)`, Jacobian `(6, n)` and drift `(6,)`, in the base frame.
        """
        values = self.code([q[:, None], passive[:, None], dq[:, None]])[:, 0]
        jacobian = values[12:-6].reshape(6, self.robot.n)
        return values[:3], values[3:12].reshape(3, 3), jacobian, values[-6:]


def frame_motion(robot: Robot, frame: Frame) -> FrameMotion:
    """Kinematics of a frame up to accelerations."""

    def build() -> tuple[Program, dict[str, Any]]:
        from steelyard.kernel.program.trace import symbolic

        inputs = [
            Input("q", robot.n), Input("passive", len(robot.passive)), Input("dq", robot.n)
        ]  # fmt: skip
        return symbolic(lambda *x: _outputs(robot, frame, *x), inputs), {}

    place = [frame.body, frame.rotation.tolist(), frame.position.tolist()]
    return FrameMotion(robot, frame, compiled(["frame motion", robot_to_dict(robot), place], build))


def _outputs(
    robot: Robot,
    frame: Frame,
    q: Sequence[Scalar],
    passive: Sequence[Scalar],
    dq: Sequence[Scalar],
) -> list[Scalar]:
    """Outputs of `frame_outputs`, and the drift: how the velocities grow while `dq` is constant."""
    from steelyard.kernel.program.trace import carried_along

    found, n = frame_outputs(robot, frame, q, passive), robot.n
    rows = np.array(found[12:], dtype=object).reshape(6, n)
    velocities = [sum((x * rate for x, rate in zip(row, dq, strict=True)), 0.0) for row in rows]
    state, _ = completed(robot, JointState(q, dq, [0.0] * n, passive))
    return [*found, *carried_along(velocities, [*q, *passive], state.dq)]

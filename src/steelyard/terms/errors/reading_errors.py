"""What efforts change with small errors of how they are read, as columns beside a model's own."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.terms.term import Columns, Dissipation, Samples, StatefulTerm


@dataclass(frozen=True)
class Misread(StatefulTerm):
    r"""Errors of efforts, around the torque $\tau$ of a reference model's bodies.

    Per joint `gain`, $\tau_j$: its effort is that share too large; and `saturation`,
    $\tau_j |\tau_j| / \tau_0$: the gain has changed by that share at a torque $\tau_0$. Both are
    without a unit. Trees only.

    Attributes:
        reference: Ten numbers per body by name; absent ones are zero.
        scale: $\tau_0$, one per joint [Nm; N]; 1 if nothing is given.
    """

    law: ClassVar[str] = "misread"
    dissipation: ClassVar[Dissipation] = "none"
    state_only_fields: ClassVar[tuple[str, ...]] = ("reference", "scale")
    reference: tuple[tuple[str, float], ...] = ()
    scale: tuple[float, ...] = ()

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Names like `gain.elbow`, `saturation.elbow`."""
        if robot.passive:
            return ()
        kinds = ("gain", "saturation")
        return tuple(Parameter(f"{kind}.{j.name}", "1") for kind in kinds for j in robot.joints)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The channels, each in its joint's row."""
        return {(k % robot.n_joints, k): c for k, c in enumerate(state.channels)}

    def n_channels(self, robot: Robot) -> int:
        """One per parameter."""
        return len(self.parameters(robot))

    def warm_up(self, robot: Robot) -> Array:
        """Nothing is remembered."""
        return np.zeros(robot.n_joints)

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """Torque of the reference model, and its square with the torque's sign."""
        names, values = [p.name for p in RigidBody().parameters(robot)], dict(self.reference)
        torque = samples.rigid_torque(np.array([values.get(name, 0.0) for name in names]))
        scale = np.array(self.scale or (1.0,) * robot.n_joints)[:, None]
        return np.concatenate((torque, torque * np.abs(torque) / scale)), None

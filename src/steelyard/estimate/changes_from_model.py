r"""What is a robot's and a day's own: changes from the fleet's model, and what data say of them.

Per joint the model's residual is explained by relative changes of its own parts, and on all joints
by what the last link carries beside the model's,

$$ \tau_j - \hat\tau_j = \delta_b\,\hat\tau_{b,j} + \delta_c\,\hat\tau_{c,j}
   + \delta_v\,\hat\tau_{v,j} + \delta_o + (Y B\,\phi_L)_j : $$

bodies, dry friction, friction that grows with speed, offset, and the ten numbers of a payload. All
are linear in the columns of the model's regressor, so the sums of products of a day give normal
equations of them: a matrix and a vector of constant size, which add.

A *cause* is what may happen to a robot, as directions in these changes: friction of a joint alone,
all that a joint's drive gain scales, a payload.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array, places_of
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import Layout
from steelyard.estimate.information.information import Information
from steelyard.estimate.payload.runs_with_payload import carrier, payload_lift

BODIES, DRY, VISCOUS, OFFSET = range(4)
OF_JOINT = 4  # changes per joint
OF_PAYLOAD = 10  # mass, first moments and inertia
EXPECTED = (1.0, 1.0, 1.0, 1.0)
"""Standard deviations of changes before any data: relative, offsets over the joint's friction."""
EXPECTED_PAYLOAD = (10.0, *3 * (3.0,), *6 * (1.0,))  # [kg, kg m, kg m²]

What = Literal["dry friction", "viscous friction", "offset", "effort scale", "payload"]


@dataclass(frozen=True, eq=False)
class Cause:
    """What may happen: its name, joint, unit, and directions in the changes, shape `(m, k)`.

    Of relative changes a size of 1 doubles what the robot has.
    """

    what: What
    joint: str  # `""` for a payload
    unit: str
    directions: Array


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Of all changes: matrix `(m, m)` and vector `(m,)`; squares and samples per row `(rows,)`."""

    matrix: Array
    vector: Array
    residual: Array  # squared residuals of the model, in variances of its own fit
    effort: Array  # squared efforts, likewise
    predicted: Array  # squared predicted efforts, likewise
    product: Array  # measured times predicted efforts, likewise
    counts: Array

    def times(self, factor: float) -> "NormalEquations":
        """The same, counted so many times."""
        return NormalEquations(**{name: factor * mine for name, mine in vars(self).items()})

    def __add__(self, other: "NormalEquations") -> "NormalEquations":
        return NormalEquations(
            **{name: mine + getattr(other, name) for name, mine in vars(self).items()}
        )


class LocalParameters:
    """Changes of one robot from a model."""

    def __init__(self, identified: IdentifiedModel, layout: Layout) -> None:
        self.identified = identified
        robot, model = identified.model.robot, identified.model
        n = robot.n
        self.values = identified.estimate.parameters.named(layout.columns)
        self.covariance = identified.estimate.covariance_of(layout.columns)  # of these, `(p, p)`
        groups = dict.fromkeys(layout.columns, BODIES)
        for term in model.terms:
            for parameter in term.parameters(robot):
                if term.cause == "offset":
                    groups[parameter.name] = OFFSET
                elif term.cause == "friction":
                    groups[parameter.name] = VISCOUS if "s" in parameter.unit else DRY
        self.groups = np.array([groups[name] for name in layout.columns])
        lift = payload_lift(robot, identified.base, carrier(robot))[:, :OF_PAYLOAD]
        self._carried = lift[places_of(layout.columns, identified.base.base_names)]
        self.size = OF_JOINT * n + OF_PAYLOAD
        self.layout, self.joints = layout, robot.joint_names
        self.units = robot.effort_units
        sigma = np.asarray(identified.estimate.sigma, dtype=np.float64)
        self.sigma = np.where(sigma > 0.0, sigma, np.inf)
        self.transforms = tuple(self._transform(row) for row in range(robot.n))

    def _transform(self, row: int) -> Array:
        """Columns of a row and its effort to changes and residual, shape `(k + 1, m + 1)`."""
        seen = list(self.layout.sees[row])
        own, groups = self.values[seen], self.groups[seen]
        found = np.zeros((len(seen) + 1, self.size + 1))
        for part in (BODIES, DRY, VISCOUS):
            found[:-1, OF_JOINT * row + part] = np.where(groups == part, own, 0.0)
        found[:-1, OF_JOINT * row + OFFSET] = groups == OFFSET
        found[:-1, self.size - OF_PAYLOAD : self.size] = self._carried[seen]
        found[:-1, -1], found[-1, -1] = -own, 1.0
        return found

    def has(self, row: int, part: int) -> bool:
        """Whether the model has such a part in a row."""
        return part in self.groups[list(self.layout.sees[row])]

    def equations(self, information: Information) -> NormalEquations:
        """What some data, their efforts as logged, say about the changes."""
        signals = self.identified.signals
        scaled = information.scaled(signals.gains, self.units)
        rows = range(len(self.joints))
        matrix, vector = np.zeros((self.size, self.size)), np.zeros(self.size)
        sums = np.zeros((4, len(self.joints)))
        for row in rows:
            gram = scaled.row_gram(row) / self.sigma[row] ** 2
            moved = self.transforms[row]
            own = moved.T @ gram @ moved
            matrix += own[:-1, :-1]
            vector += own[:-1, -1]
            known = np.append(self.values[list(self.layout.sees[row])], 0.0)
            sums[:, row] = own[-1, -1], gram[-1, -1], known @ gram @ known, gram[-1] @ known
        residual, effort, predicted, product = sums
        return NormalEquations(
            matrix, vector, residual, effort, predicted, product, scaled.n_samples
        )

    def of_model(self, information: Information) -> Array:
        """Right-hand sides that errors of the model's values would make, `(m, p)`."""
        scaled = information.scaled(self.identified.signals.gains, self.units)
        found = np.zeros((self.size, len(self.layout.columns)))
        for row, seen in enumerate(self.layout.sees):
            gram = scaled.row_gram(row)[:-1, :-1] / self.sigma[row] ** 2
            found[:, list(seen)] += self.transforms[row][:-1, :-1].T @ gram
        return found

    def unexplained(self, one: NormalEquations) -> float:
        """Squared residual that its own changes leave, per sample, in variances of the fit."""
        ridge = np.diag(self.expected(self.friction([one])) ** -2.0)
        explained = one.vector @ np.linalg.solve(one.matrix + ridge, one.vector)
        return float(max(one.residual.sum() - explained, 0.0) / max(one.counts.sum(), 1.0))

    def friction(self, information: Sequence[NormalEquations]) -> Array:
        """Root mean square of each joint's friction over some data, shape `(n,)` [Nm; N]."""
        total = sum(one.matrix for one in information)
        counts = np.maximum(sum(one.counts for one in information), 1.0)
        places = OF_JOINT * np.arange(len(self.joints))
        squares = sum(np.diag(total)[places + part] for part in (DRY, VISCOUS))
        return np.asarray(np.sqrt(squares / counts) * self.sigma)

    def causes(self, level: Array) -> tuple[Cause, ...]:
        """What may happen to a robot whose changes from the model are usually `level`, `(m,)`.

        A gain scales the robot's own friction, not the model's.
        """
        found = list[Cause]()
        for row, joint in enumerate(self.joints):
            used = set(self.groups[list(self.layout.sees[row])].tolist())
            each: dict[What, tuple[int, ...]] = {
                "dry friction": (DRY,), "viscous friction": (VISCOUS,), "offset": (OFFSET,),
                "effort scale": tuple(sorted({BODIES, DRY, VISCOUS} & used)),
            }  # fmt: skip
            for what, parts in each.items():
                if used.issuperset(parts):
                    direction = np.zeros((self.size, 1))
                    places = [OF_JOINT * row + part for part in parts]
                    direction[places, 0] = 1.0 + level[places] if what != "offset" else 1.0
                    unit = self.units[row] if what == "offset" else ""
                    found.append(Cause(what, joint, unit, direction))
        carried = np.zeros((self.size, OF_PAYLOAD))
        carried[self.size - OF_PAYLOAD :] = np.eye(OF_PAYLOAD)
        return (*found, Cause("payload", "", "kg", carried))

    def expected(self, friction: Array) -> Array:
        """Standard deviations of all changes before any data, shape `(m,)`."""
        each = np.tile(EXPECTED, (len(self.joints), 1))
        each[:, OFFSET] *= np.where(friction > 0.0, friction, 1.0)
        return np.concatenate([each.ravel(), EXPECTED_PAYLOAD])

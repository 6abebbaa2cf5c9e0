r"""Causes of what a fit leaves: columns that the model lacks, ranked by what they explain.

With weights $1 / \sigma_j^2$ the residuals of a fit have $\chi^2 = \sum_j N_j$; noise accounts
for $\sum_j N_j / r_j^2$ of it, where residuals are $r_j$ times the measurement noise. A cause is a
group of columns $X$ beside those of the model, $A$: the fit of both together lowers $\chi^2$ by
$s^T S^+ s$ with the score $s = X^T W (b - A \hat\phi)$ and $S$ the part of $X^T W X$ that $A$
does not express [Rao1948]. Its share is that over what noise does not account for. Errors of the
geometry enter by the torque's derivatives at the fitted parameters: a large error is found by its
first order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.fields.load_friction_reference import bodies_of
from steelyard.estimation.per_run import Runs, own_columns
from steelyard.model import Model
from steelyard.regression.information import Information
from steelyard.terms.errors.geometry_errors import Displaced
from steelyard.terms.errors.reading_errors import Misread
from steelyard.terms.laws.load_dependent import LoadDependent
from steelyard.terms.laws.powers import Quadratic
from steelyard.terms.laws.presliding import Dahl
from steelyard.terms.laws.spring import Spring
from steelyard.terms.laws.stribeck import Stribeck
from steelyard.terms.term import Term

NEW = 1e-6
"""Part of a column, squared and relative, that the model's columns must leave for it to count."""

GEOMETRY = ("position", "axis")

COMPLEXITY = 0.02
"""Share of its effect that each further column of a cause costs in the ranking."""

FRICTION: tuple[tuple[str, Term], ...] = (
    ("Stribeck friction (term stribeck)", Stribeck(speed=0.1)),
    ("friction nonlinear in speed (term quadratic)", Quadratic()),
    ("load-dependent friction (term load_dependent)", LoadDependent()),
    ("presliding friction (term dahl)", Dahl(length=3e-3)),
    ("a spring (term spring)", Spring()),
)
"""Terms that a model may lack, each on all joints."""


@dataclass(frozen=True)
class Cause:
    """One cause, and how much it explains.

    Attributes:
        kind: `zero_offset`, `gain`, `saturation`, `compliance`, `position`, `axis`, `tilt` (of the
            first axis, the same as of gravity), `geometry`, or the law of a term.
        joint: The joint; empty if it is about all.
        says: In a few words.
        names: Names of its columns.
        chi2: What it takes from chi square.
        share: Of the chi square that noise does not account for, 0 to 1.
    """

    kind: str
    joint: str
    says: str
    names: tuple[str, ...]
    chi2: float
    share: float

    @property
    def columns(self) -> int:
        """Number of its columns."""
        return len(self.names)

    @property
    def rank(self) -> float:
        """What sorts causes: of two that explain alike, the one with fewer columns leads."""
        return self.chi2 * max(0.0, 1.0 - COMPLEXITY * (self.columns - 1))

    @property
    def of_friction(self) -> bool:
        """Whether it is a term of the model's, not an error of the geometry or of the efforts."""
        return self.kind in {term.law for _, term in FRICTION}


def wide_model(model: Model, estimate: Estimate) -> Model:
    """The model with columns of all causes behind its own; those that it has are left out."""
    bodies = tuple(bodies_of(estimate).items())
    laws = {term.law for term in model.terms}
    lacking = [term.with_reference(dict(bodies)) for _, term in FRICTION if term.law not in laws]
    kinds = ("zero_offset", "compliance", *GEOMETRY)
    geometry = (Displaced(kinds, bodies), Misread(bodies))  # type: ignore[arg-type]
    return replace(model, terms=(*model.terms, *lacking, *geometry))


def causes(
    model: Model, information: Information, sigma: Array, ratios: Array
) -> tuple[Cause, ...]:
    """All causes, the most likely first.

    Args:
        model: The fitted model.
        information: Of the columns of `wide_model`.
        sigma: Standard deviations of the fit's residuals, shape `(n,)`.
        ratios: Of these over the measurement noise; NaN where that is not known.
    """
    counts = information.n_samples
    seen = (counts > 0.0) & (sigma > 0.0)
    weights = np.where(seen, 1.0 / np.square(np.where(seen, sigma, 1.0)), 0.0)
    noise = np.where(np.isfinite(ratios), np.minimum(1.0, 1.0 / np.square(ratios)), 1.0)
    excess = float(np.sum((counts * (1.0 - noise))[seen]))
    score, left, names = _scores(model, information, weights)
    found = []
    for kind, joint, says, columns in _groups(model, names):
        chi2 = _explained(score, left, [names.index(column) for column in columns])
        share = min(1.0, chi2 / excess) if excess > 0.0 else 0.0
        found.append(Cause(kind, joint, says, columns, chi2, share))
    return tuple(sorted(found, key=lambda cause: -cause.rank))


def _scores(
    model: Model, information: Information, weights: Array
) -> tuple[Array, Array, list[str]]:
    """Score and information of the added columns, of unit length each, and their names."""
    own, names = set(model.names), information.layout.columns
    per_run = tuple(c for c in names if c in set(own_columns(model)))
    matrix, vector, _, squares = Runs.of(information, per_run).normal(weights)
    lengths = np.sqrt(np.maximum(squares, 0.0))
    scale = np.where(lengths > 1e-12 * lengths.max(initial=1e-300), lengths, np.inf)
    matrix, vector = matrix / scale[:, None] / scale, vector / scale
    mine = [k for k, c in enumerate(names) if c in own and c not in per_run]
    added = [k for k, c in enumerate(names) if c not in own]
    inverse = np.linalg.pinv(matrix[np.ix_(mine, mine)], rcond=1e-12, hermitian=True)
    across = matrix[np.ix_(added, mine)] @ inverse
    score = vector[added] - across @ vector[mine]
    left = matrix[np.ix_(added, added)] - across @ matrix[np.ix_(mine, added)]
    return score, 0.5 * (left + left.T), [names[k] for k in added]


def _explained(score: Array, left: Array, group: Sequence[int]) -> float:
    """What a group of columns takes from chi square."""
    part = left[np.ix_(group, group)]
    values, vectors = np.linalg.eigh(part)
    along = vectors.T @ score[list(group)]
    new = values > NEW
    return float(np.sum(np.square(along[new]) / values[new]))


def _groups(model: Model, names: Sequence[str]) -> list[tuple[str, str, str, tuple[str, ...]]]:
    """Kind, joint, words and columns of every cause whose columns are there."""
    robot = model.robot
    groups: list[tuple[str, str, str, tuple[str, ...]]] = []
    for joint in robot.joint_names:
        for kind, says in (
            ("zero_offset", f"zero offset of {joint}"),
            ("gain", f"gain or scale of the effort of {joint}"),
            ("saturation", f"gain of {joint} that changes with the torque"),
            ("compliance", f"elasticity of {joint}"),
        ):
            groups.append((kind, joint, says, (f"{kind}.{joint}",)))
    for body in robot.bodies:
        place = tuple(f"position_{axis}.{body.joint}" for axis in "xyz")
        groups.append(
            ("position", body.joint, f"position of joint {body.joint} (link length)", place)
        )
        tilt = tuple(f"axis_{k}.{body.joint}" for k in (1, 2))
        if body.parent < 0:
            groups.append(("tilt", body.joint, f"tilt of the base (axis of {body.joint})", tilt))
        else:
            groups.append(("axis", body.joint, f"axis of joint {body.joint}", tilt))
    every = tuple(c for c in names if c.split(".")[0].split("_")[0] in GEOMETRY)
    groups.append(("geometry", "", "geometry of several links (lengths, axes)", every))
    for says, term in FRICTION:
        mine = tuple(p.name for p in term.parameters(robot))
        groups.append((term.law, "", says, mine))
    present = set(names)
    return [g for g in groups if g[3] and present.issuperset(g[3])]

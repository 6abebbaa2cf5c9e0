"""Links as bodies: mass, centre, moments of inertia, physical consistency."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Z95, StandardEstimate
from steelyard.estimation.identified import IdentifiedModel
from steelyard.estimation.prior.prior import model_prior, rigid_bodies
from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import NONE, alike, fixed, share, significant
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia

WORDS = (
    "Estimate of each link from data and prior, with 95 % intervals. The data alone determine only "
    "the base parameters above; the prior determines how their sums are distributed over links. "
    "Margin: distance from physical inconsistency, 1 being the prior of the model file and 0 "
    "the limit (smallest eigenvalue of the pseudo-inertia in the prior's scale)."
)
HEADINGS = (
    "Link",
    "Mass ± [kg]",
    "In the file [kg]",
    "Centre x, y, z ± [m]",
    "Principal moments [kg m²]",
    "From data (mean of ten)",
    "Margin",
)


@dataclass(frozen=True, eq=False)
class Solid:
    """One link.

    Attributes:
        name: The link.
        inertia: Its mass properties.
        covariance: Of the ten numbers, shape `(10, 10)`.
        learned: Mean share of the ten numbers that comes from the data, 0 to 1.
        nominal: Mass properties in the model file; `None` if it has none.
        margin: Smallest eigenvalue of the pseudo-inertia in the scale of the prior.
    """

    name: str
    inertia: Inertia
    covariance: Array
    learned: float
    nominal: Inertia | None
    margin: float

    @property
    def com_std(self) -> Array:
        """Standard deviation of the centre of mass, to first order, shape `(3,)` [m]."""
        if not self.inertia.mass:
            return np.full(3, np.nan)
        slope = np.column_stack([-self.inertia.com, np.eye(3)]) / self.inertia.mass
        variances = np.diag(slope @ self.covariance[:4, :4] @ slope.T)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


class BodiesSection(TableSection):
    """One row per link, and their sum."""

    name: ClassVar[str] = "bodies"
    title: ClassVar[str] = "Link inertial parameters"

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """The table, if the estimate knows all standard parameters."""
        identified = content.identified
        if identified is None or identified.estimate.standard is None:
            return []
        links = tuple(solids(identified))
        if not links:
            return []
        total = _total(identified, identified.estimate.standard)
        rows = [_row(link) for link in links]
        return [PlainTable("", WORDS, HEADINGS, [*rows, total], (0, 3, 4))]


def solids(identified: IdentifiedModel) -> Iterator[Solid]:
    """The links of an estimate that knows all standard parameters."""
    standard, robot = identified.estimate.standard, identified.model.robot
    if standard is None:
        return
    place = {name: k for k, name in enumerate(standard.parameters.names)}
    for number, body in rigid_bodies(identified.model).items():
        ten = [place[f"{kind}.{body.name}"] for kind in INERTIAL_NAMES]
        inertia = Inertia.from_ten(standard.parameters.values[ten])
        yield Solid(
            body.name,
            inertia,
            standard.covariance[np.ix_(ten, ten)],
            float(standard.learned[ten].mean()),
            body.inertia if body.known else None,
            margin(inertia, model_prior(robot, number).inertia),
        )


def margin(inertia: Inertia, prior: Inertia) -> float:
    """Smallest eigenvalue of the pseudo-inertia in the scale of a prior's; no unit."""
    factor = np.linalg.cholesky(prior.pseudo)
    half = np.linalg.solve(factor, inertia.pseudo)
    return float(np.linalg.eigvalsh(np.linalg.solve(factor, half.T)).min())


def _row(link: Solid) -> Row:
    inertia = link.inertia
    possible = "" if link.margin > 0.0 else ": not physically consistent"
    moments = np.linalg.eigvalsh(inertia.inertia_com)
    centre = ", ".join(
        f"{fixed(c)} ± {fixed(Z95 * s)}" for c, s in zip(inertia.com, link.com_std, strict=True)
    )
    return Row(
        (
            link.name,
            _with(inertia.mass, float(np.sqrt(np.maximum(link.covariance[0, 0], 0.0)))),
            significant(None if link.nominal is None else link.nominal.mass),
            centre if inertia.mass else NONE,
            ", ".join(significant(float(x)) for x in moments),
            share(100.0 * link.learned),
            f"{significant(link.margin, 2)}{possible}",
        )
    )


def _total(identified: IdentifiedModel, standard: StandardEstimate) -> Row:
    """The masses of all links together; their intervals do not add."""
    bodies = rigid_bodies(identified.model).values()
    place = {name: k for k, name in enumerate(standard.parameters.names)}
    mine = [place[f"m.{body.name}"] for body in bodies]
    variance = max(float(standard.covariance[np.ix_(mine, mine)].sum()), 0.0)
    nominal = sum(body.inertia.mass for body in bodies)
    return Row(
        (
            "all links",
            _with(float(standard.parameters.values[mine].sum()), float(np.sqrt(variance))),
            significant(nominal) if all(body.known for body in bodies) else NONE,
            *("",) * 4,
        ),
        total=True,
    )


def _with(value: float, std: float) -> str:
    half = Z95 * std
    return f"{alike(value, half)} ± {significant(half, 2)}"

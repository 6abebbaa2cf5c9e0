"""The estimate of a payload: ten numbers about a named frame, and what follows from them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Z95, Array, finite_json, frozen
from steelyard.base.errors import DataError
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, INERTIAL_UNITS, Inertia, skew
from steelyard.robot.robot import Frame, Robot

NOISE = 18.3  # 95 % quantile of the rise of χ² that noise explains: that of ten degrees of freedom
BEYOND_DOUBT = 3.0  # standard deviations below zero from which on the data ask for a negative mass


@dataclass(frozen=True, eq=False)
class PayloadEstimate:
    """The ten numbers of a payload, about a frame's origin and along its axes; NaN if not seen.

    Of a body that the model's logs carried and these do not, they are the negative ones of a body.
    """

    frame: str  # the frame
    body: str  # the link that carries it
    ten: Array  # the numbers in Pinocchio's order, `(10,)`
    covariance: Array  # `(10, 10)`
    sigma: Array  # standard deviation of the filtered residuals per effort row, `(rows,)`
    n_samples: Array  # filtered samples per effort row, `(rows,)`
    notes: tuple[str, ...] = ()  # what was taken for granted, for people to read
    # rise of the weighted squares by the constraint of physical consistency
    chi_squared: float = 0.0
    free_mass: float | None = None  # mass without this constraint [kg]; `None` if it is not known
    # what the model does not explain with any payload; empty if there is nothing
    unexplained: str = ""

    def __repr__(self) -> str:
        return (
            f"PayloadEstimate({_interval(self.mass, self.half_width[0], 'kg')} on '{self.frame}')"
        )

    def __str__(self) -> str:
        mass = _interval(self.mass, self.half_width[0], "kg")
        centre = ", ".join(map(_interval, self.com, self.com_half_width, 3 * "m"))
        return "\n".join(
            [
                f"payload in frame '{self.frame}', with 95 % intervals",
                f"mass    {mass}",
                f"centre  {centre}",
                *self.remarks,
                *(f"note: {note}" for note in self.notes),
            ]
        )

    @property
    def removed(self) -> bool:
        """Whether it is a body that is not there, though it was in the model's logs."""
        return bool(self.mass < 0.0)

    @property
    def inertia(self) -> Inertia:
        """The numbers as mass properties in the frame, of the body that was removed if one was."""
        return Inertia.from_ten(-self.ten if self.removed else self.ten)

    @property
    def half_width(self) -> Array:
        """Half-widths of the 95 % intervals of the ten numbers."""
        return Z95 * np.sqrt(np.diag(self.covariance))

    @property
    def mass(self) -> float:
        """[kg]."""
        return float(self.ten[0])

    @property
    def com(self) -> Array:
        """Centre of mass in the frame, shape `(3,)` [m]."""
        return self.inertia.com

    @property
    def inertia_com(self) -> Array:
        """Inertia about the centre of mass, frame's axes, shape `(3, 3)` [kg m²]."""
        return self.inertia.inertia_com

    @property
    def com_half_width(self) -> Array:
        """Half-widths of the 95 % intervals of the centre, by the delta method, shape `(3,)`."""
        slope = np.zeros((3, 10))
        if mass := abs(self.mass):
            slope[:, 0] = -self.com / mass
            slope[:, 1:4] = np.eye(3) / mass
        return self._through(slope)

    @property
    def inertia_com_half_width(self) -> Array:
        """The same of the inertia about the centre, shape `(3, 3)`."""
        slope = np.zeros((6, 10))  # of (xx, xy, yy, xz, yz, zz) over the ten numbers
        slope[:, 4:] = np.eye(6)
        if mass := abs(self.mass):
            h = skew(self.inertia.ten[1:4])
            change = [-h @ h / mass**2]
            change += [(skew(e) @ h + h @ skew(e)) / mass for e in np.eye(3)]
            for column, matrix in enumerate(change):
                slope[:, column] = matrix[(0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
        return np.asarray(self._through(slope)[[(0, 1, 3), (1, 2, 4), (3, 4, 5)]])

    @property
    def not_seen(self) -> tuple[str, ...]:
        """Names of the numbers that the data do not see."""
        return tuple(n for n, x in zip(INERTIAL_NAMES, self.ten, strict=True) if np.isnan(x))

    @property
    def weighs(self) -> bool:
        """Whether the interval of the mass excludes zero."""
        return bool(abs(self.mass) > self.half_width[0])

    @property
    def negative_mass(self) -> float | None:
        """Mass that the data ask for if it is negative beyond doubt [kg]; `None` otherwise."""
        free, std = self.free_mass, float(np.sqrt(self.covariance[0, 0]))
        return free if free is not None and free < -BEYOND_DOUBT * std else None

    @property
    def flaw(self) -> str | None:
        """Why no real body has these numbers; `None` if one can, or no payload is seen."""
        return None if self.not_seen or not self.weighs else self.inertia.flaw()

    @property
    def remarks(self) -> tuple[str, ...]:
        """How far the numbers can be trusted, one sentence each."""
        found = [self.unexplained] if self.unexplained else []
        if self.not_seen:
            found.append(f"not identifiable from these data: {', '.join(self.not_seen)}")
        if np.isnan(self.mass):
            return tuple(found)
        if self.removed:
            found.append(
                "the arm carries less than in the model's logs: a tool or payload was removed, or "
                "gains differ from theirs"
            )
        elif self.negative_mass is not None:
            found.append(
                f"without the constraint of physical consistency, the data ask for a negative mass "
                f"of about {self.negative_mass:.2g} kg: gains, tool or model differ from those of "
                "the model's logs"
            )
        if not self.weighs:
            return (*found, "the interval of the mass contains zero: no payload is detected")
        moments, widths = np.diag(self.inertia_com), np.diag(self.inertia_com_half_width)
        pairs = list(zip(("Ixx", "Iyy", "Izz"), moments, widths, strict=True))
        weak = [name for name, value, width in pairs if not abs(value) > width]
        below = [name for name, value, width in pairs if value < -width]
        if below:
            found.append(
                f"{', '.join(below)} have intervals entirely below zero, which is physically "
                "impossible: model or gains have errors that the intervals do not cover"
            )
        found.append(
            f"the inertia is poorly identified: the interval of {', '.join(weak)} contains zero"
            if weak
            else "the inertia is identified: no interval of a moment of inertia contains zero"
        )
        if self.chi_squared > NOISE:
            found.append(
                f"the constraint of physical consistency raises χ² by {self.chi_squared:.0f} "
                f"(up to {NOISE:.0f} is within noise): the inertia contains model error"
            )
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, with 95 % half-widths; `None` for what the data do not see."""
        seen = self.weighs
        return {
            "schema": "steelyard.payload",
            "schema_version": 1,
            "frame": self.frame,
            "link": self.body,
            "mass": finite_json(self.mass),
            "mass_half_width": finite_json(self.half_width[0]),
            "negative_mass": self.negative_mass,
            "centre": finite_json(self.com) if seen else None,
            "centre_half_width": finite_json(self.com_half_width) if seen else None,
            "inertia_com": finite_json(self.inertia_com) if seen else None,
            "inertia_com_half_width": finite_json(self.inertia_com_half_width) if seen else None,
            "names": list(INERTIAL_NAMES),
            "units": list(INERTIAL_UNITS),
            "ten": finite_json(self.ten),
            "covariance": finite_json(self.covariance),
            "not_seen": list(self.not_seen),
            "consistent_body": self.flaw is None if seen and not self.not_seen else None,
            "flaw": self.flaw,
            "unexplained": self.unexplained or None,
            "chi_squared_rise": self.chi_squared,
            "remarks": list(self.remarks),
            "notes": list(self.notes),
        }

    def _through(self, slope: Array) -> Array:
        """Half-widths behind a linear map; numbers with slope zero do not matter."""
        widths = []
        for row in slope:
            used = np.flatnonzero(row)
            part = self.covariance[np.ix_(used, used)]
            widths.append(Z95 * np.sqrt(row[used] @ part @ row[used]))
        return np.array(widths)


def payload_of(
    frame: Frame, robot: Robot, ten: Array, covariance: Array, **found: Any
) -> PayloadEstimate:
    """The estimate, with what the covariance knows nothing of taken out of the values."""
    refuse_unseen(covariance, frame)
    values = frozen(np.where(np.isnan(np.diag(covariance)), np.nan, ten))
    body = robot.bodies[frame.body].name
    return PayloadEstimate(frame.name, body, values, frozen(covariance), **found)


def refuse_unseen(covariance: Array, frame: Frame) -> None:
    """Data that see none of the payload's numbers weigh nothing."""
    if np.isnan(np.diag(covariance)).all():
        wrong = "no parameter of the payload is identifiable from the data"
        fix = "log a motion that turns the payload against gravity, with and without it"
        raise DataError(wrong, where=f"frame '{frame.name}'", fix=fix)


def _interval(value: float, half: float, unit: str) -> str:
    return f"{value:.4g} ± {half:.2g} {unit}" if np.isfinite(value) else "not identifiable"

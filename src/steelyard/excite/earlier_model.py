"""What a model that was identified before knows for the design of a motion."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot


@dataclass(frozen=True, eq=False)
class Earlier:
    """What was learnt from an earlier log.

    The `noise` of the filtered residuals, `(n,)` [Nm; N], and their filter's cutoff [Hz]; `values`,
    `(p,)`, of the base parameters that were estimated, and their covariance, `(p, p)`; standard
    parameters by name; the base parameters that the model was reduced by (`removed`) are zero.
    """

    noise: Array
    cutoff: float
    names: tuple[str, ...]
    values: Array
    covariance: Array
    standard: Mapping[str, float]
    removed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise", frozen(self.noise, (None,)))
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "values", frozen(self.values, (len(self.names),)))
        object.__setattr__(self, "covariance", frozen(self.covariance, (len(self.names),) * 2))

    @property
    def independent_rate(self) -> float:
        """Independent samples a second behind the filter [Hz]."""
        design = ParallelFilter.design(self.cutoff, _RATE_OVER_CUTOFF * self.cutoff)
        return design.rate / (design.decimation * design.inflation)

    @property
    def weights(self) -> Array:
        """Information that a second holds, per squared regressor entry, shape `(n,)`."""
        return np.asarray(self.independent_rate / self.noise**2)

    def information(self, base: BaseMap, absent: Collection[str] = ()) -> Array:
        """Information on a model's base parameters, `(b, b)`; none on those not estimated.

        Parameters that the model does without (`absent`) are known to be zero.
        """
        place = {name: k for k, name in enumerate(base.base_names)}
        known = [k for k, name in enumerate(self.names) if name in place or name in absent]
        own = np.linalg.pinv(self.covariance[np.ix_(known, known)], hermitian=True)
        left = [k for k, name in enumerate(self.names[j] for j in known) if name in place]
        targets = [place[self.names[known[k]]] for k in left]
        full = np.zeros((len(base), len(base)))
        full[np.ix_(targets, targets)] = own[np.ix_(left, left)]
        return full


def earlier_of(identified: IdentifiedModel) -> Earlier:
    """What an identified model knows for the design of a motion."""
    estimate = identified.estimate
    return Earlier(
        estimate.sigma,
        identified.cutoffs.matched,
        estimate.parameters.names,
        estimate.parameters.values,
        estimate.covariance,
        estimate.values.as_dict(),
        (*(one.name for one in estimate.removed), *estimate.known),
    )


def identified_before(
    earlier: str | Path | IdentifiedModel, loaded: LoadedRobot
) -> IdentifiedModel:
    """An earlier model of the robot."""
    known = load_model(earlier)
    where = "earlier model" if isinstance(earlier, IdentifiedModel) else str(earlier)
    theirs, ours = known.model.robot.joint_names, loaded.robot.joint_names
    if theirs != ours:
        raise DataError(
            f"the earlier model moves the joints {', '.join(theirs)}, this robot {', '.join(ours)}",
            where=where,
            fix="give a model that was identified with this robot file, or the model's robot file",
        )
    if not (known.estimate.sigma > 0.0).all():
        raise DataError(
            "the earlier model fits a joint's efforts without any noise",
            where=where,
            fix="leave --earlier out: noise is then assumed",
        )
    return known


_RATE_OVER_CUTOFF = 20.0  # sampling rate; the independent samples a second do not depend on it

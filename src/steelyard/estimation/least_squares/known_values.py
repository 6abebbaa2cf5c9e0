r"""Least squares with known parameters: their part is moved to the measured efforts.

Of $\tau = X \varphi$ with known $\varphi_k$, $\tau - X_k \varphi_k = X_u \varphi_u$ is solved for
the others: columns of known parameters are left out, so the values are met exactly.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import frozen
from steelyard.estimation.estimate import Estimate, Estimator
from steelyard.estimation.knowledge import Knowledge
from steelyard.parameters import Parameters
from steelyard.regression.base import BaseMap
from steelyard.regression.information import Information
from steelyard.regression.regressor import Layout


@dataclass(frozen=True)
class Fixed:
    """Base parameters that prior constraints determine alone.

    Attributes:
        values: By name of the base parameter.
        unused: Labels of the constraints that determine none.
    """

    values: Mapping[str, float]
    unused: tuple[str, ...]


def fixed_values(base: BaseMap, knowledge: Knowledge) -> Fixed:
    """Base parameters all of whose members have a known value.

    Args:
        base: Standard parameters to base parameters.
        knowledge: Its constraints that give a standard parameter a value count.
    """
    known: dict[str, float] = {}
    for row in knowledge.rows:
        if len(row.coefficients) == 1 and row.lower == row.upper:
            ((name, factor),) = row.coefficients.items()
            known[name] = row.lower / factor
    values, used = dict[str, float](), {base.names[k] for k in base.unseen}
    for name, lift in zip(base.base_names, base.lift, strict=True):
        members = {base.names[k]: float(lift[k]) for k in np.flatnonzero(lift)}
        if members.keys() <= known.keys():
            values[name] = sum(factor * known[member] for member, factor in members.items())
            used |= members.keys()
    unused = [
        row.label
        for row in knowledge.rows
        if row.lower != row.upper or not row.coefficients.keys() <= used & known.keys()
    ]
    return Fixed(values, tuple(unused))


@dataclass(frozen=True, eq=False)
class WithKnownValues:
    """An estimator of the parameters that are not known.

    Attributes:
        inner: Estimates the others.
        values: Known parameters by name; those that are no columns have no effect.
    """

    inner: Estimator[Information]
    values: Mapping[str, float]

    def __call__(self, information: Information) -> Estimate:
        """Estimate the columns that are not known; the known ones have no uncertainty."""
        columns = information.layout.columns
        known = {name: self.values[name] for name in columns if name in self.values}
        if not known:
            return self.inner(information)
        found = self.inner(without_known(information, known))
        return _joined(found, information.layout, known)


def without_known(information: Information, known: Mapping[str, float]) -> Information:
    """The data of the other columns, the known part taken from the efforts."""
    layout = information.layout
    left = [k for k, name in enumerate(layout.columns) if name not in known]
    place = {column: k for k, column in enumerate(left)}
    sees = tuple(tuple(place[c] for c in seen if c in place) for seen in layout.sees)
    parts = []
    for old, new in zip(layout.sees, sees, strict=True):
        part = np.zeros((len(old) + 1, len(new) + 1))
        part[-1, -1] = 1.0
        for k, column in enumerate(old):
            if column in place:
                part[k, new.index(place[column])] = 1.0
            else:
                part[k, -1] = -known[layout.columns[column]]
        parts.append(part)
    names, units = ([of[k] for k in left] for of in (layout.columns, layout.units))
    return information.mapped(Layout(tuple(names), tuple(units), layout.rows, sees), parts)


def _joined(estimate: Estimate, layout: Layout, known: Mapping[str, float]) -> Estimate:
    """The estimate with the known parameters among the others, in the order of the columns."""
    found = estimate.parameters.as_dict()
    order = [k for k, name in enumerate(layout.columns) if name in found or name in known]
    names = tuple(layout.columns[k] for k in order)
    at = [names.index(name) for name in estimate.parameters.names]
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(at, at)] = estimate.covariance
    values = [known[name] if name in known else found[name] for name in names]
    return replace(
        estimate,
        parameters=Parameters(names, tuple(layout.units[k] for k in order), values),
        covariance=frozen(covariance),
        known=tuple(name for name in names if name in known),
    )

"""What an estimator returns: named numbers, their uncertainty, and what the data did not see."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from steelyard.base.arrays import (
    Z95,
    Array,
    Parameters,
    frozen,
    json_values,
    of_json_values,
    set_fields,
)

Data = TypeVar("Data", contravariant=True)


class Estimator(Protocol[Data]):
    """From data to parameters.

    What an estimator has to look at is in its type: `Estimator[Information]` needs sums of
    products alone, `Estimator[Samples]` filtered samples, `Estimator[Experiment]` raw signals and,
    if it simulates, the controller.
    """

    def __call__(self, data: Data, /) -> "Estimate":
        """Estimate the parameters; a `DataError` says why the data cannot give an estimate."""


@dataclass(frozen=True)
class Unidentifiable:
    """A base parameter that the data do not show."""

    name: str
    tied_to: tuple[str, ...] = ()  # parameters of indistinguishable columns; empty if zero


@dataclass(frozen=True)
class Removed:
    """A base parameter that a reduction removed: it is known to be zero, not unknown."""

    name: str
    step: int  # number of the step that removed it, from 1 on
    cost: float  # rise of chi-squared by its removal, residuals counted by their correlation
    criterion: str = ""  # name of the criterion that chose it, empty in files of earlier versions
    worth: float | None = None  # its value of that criterion before its removal


@dataclass(frozen=True, eq=False)
class RunParameters:
    """Parameters that one run has for itself, and their standard deviations, shape `(l,)`."""

    run: str
    parameters: Parameters
    std: Array


class _Estimated:
    """Parameters with a covariance."""

    parameters: Parameters
    covariance: Array  # shape `(p, p)`

    def __post_init__(self) -> None:
        size = len(self.parameters)
        set_fields(self, covariance=np.reshape(self.covariance, (size, size)))

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter, shape `(p,)`."""
        return np.sqrt(np.diag(self.covariance))

    def covariance_of(self, names: Sequence[str]) -> Array:
        """Covariance of parameters by name, `(k, k)`; zero of those that are not here."""
        known = {name: k for k, name in enumerate(self.parameters.names)}
        places = [known.get(name, -1) for name in names]
        return np.asarray(np.pad(self.covariance, (0, 1))[np.ix_(places, places)])

    def _without(self, names: Collection[str]) -> dict[str, Any]:
        """Fields without some of the parameters."""
        kept = [k for k, name in enumerate(self.parameters.names) if name not in names]
        covariance = frozen(self.covariance[np.ix_(kept, kept)])
        learned: Array | None = getattr(self, "learned", None)
        return {
            "parameters": self.parameters.of(kept),
            "covariance": covariance,
            "learned": None if learned is None else frozen(learned[kept]),
        }


@dataclass(frozen=True, eq=False)
class StandardEstimate(_Estimated):
    """Values of all standard parameters, as data and prior together have them.

    `learned` is the share of each parameter's knowledge that comes from the data, 0 to 1, shape
    `(p,)`: one minus the ratio of its variance after the data to that before; 1 where nothing was
    known before, 0 of what was given or no data show.
    """

    parameters: Parameters
    covariance: Array  # shape `(p, p)`
    learned: Array

    def without(self, names: Collection[str]) -> "StandardEstimate":
        """The values without those of some parameters."""
        return StandardEstimate(**self._without(names))


@dataclass(frozen=True, eq=False)
class Evolution:
    """Bounds and generations of the genetic algorithm that an estimate is from."""

    names: tuple[str, ...]  # parameters that were searched, `p` of them
    lower: Array  # lower bounds of the parameters, shape `(p,)`
    upper: Array  # upper bounds, likewise
    best: Array  # least root mean square error after each generation, shape `(g,)` [Nm; N]
    mean: Array  # its mean over the individuals of each generation, likewise
    least_squares: float  # the same error of least squares without bounds [Nm; N]


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(_Estimated):
    """Estimated base parameters.

    Attributes:
        estimator: What made it, for people to read.
        parameters: The parameters that the data see.
        covariance: Shape `(p, p)`, corrected for the filter's correlation of residuals.
        blind: What the data do not see; such parameters are left at zero.
        sigma: Standard deviation of the filtered residuals per effort row, shape `(rows,)`.
        n_samples: Filtered samples per effort row, shape `(rows,)`.
        condition: Condition number of the whitened regressor, columns as they are.
        condition_normalised: The same with columns scaled to unit length.
        per_run: Parameters of single runs; `parameters` then holds what a new run is to be
            expected to have, their mean, with the variance between runs.
        standard: Values of all standard parameters, of estimators that know a prior; what the
            data do not see is then as the prior says.
        learned: Share of each of `parameters` that comes from the data, 0 to 1, shape `(p,)`; all
            ones without a prior.
        at_bound: Those of `parameters` that a bound of a law or of the user holds: the data would
            have them beyond it.
        notes: What was decided on the way, for people to read.
        removed: Parameters that the model was reduced by, in the order of their removal; they are
            zero, and in none of the other lists.
        known: Those of `parameters` that were not estimated, as prior constraints give their value;
            they have no uncertainty.
        evolution: How the genetic algorithm came to them, if they are from it.

    Example:
        >>> estimate = load_model("arm-model").estimate
        >>> len(estimate.std) == len(estimate.parameters)
        True
    """

    estimator: str
    parameters: Parameters
    covariance: Array
    blind: tuple[Unidentifiable, ...]
    sigma: Array
    n_samples: Array
    condition: float
    condition_normalised: float
    per_run: tuple[RunParameters, ...] = ()
    standard: StandardEstimate | None = None
    learned: Array | None = None
    at_bound: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    removed: tuple[Removed, ...] = ()
    known: tuple[str, ...] = ()
    evolution: Evolution | None = None

    def __repr__(self) -> str:
        return f"Estimate({self.estimator}: {len(self.parameters)} parameters)"

    @property
    def values(self) -> Parameters:
        """What a model is to be given: all standard parameters where they are known."""
        return self.parameters if self.standard is None else self.standard.parameters

    @property
    def half_width(self) -> Array:
        """Half-width of the 95 % intervals, shape `(p,)`."""
        return Z95 * self.std

    def without(self, names: Collection[str]) -> "Estimate":
        """The estimate without some of its base parameters; standard ones stay."""
        blind = tuple(one for one in self.blind if one.name not in names)
        bound = tuple(name for name in self.at_bound if name not in names)
        return replace(self, **self._without(names), blind=blind, at_bound=bound)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return dict(json_values(self))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Estimate":
        """The estimate that `to_dict` wrote."""
        found = of_json_values(cls, data)
        parts: list[Estimate | StandardEstimate] = [found]
        for one in parts + ([] if found.standard is None else [found.standard]):
            size = len(one.parameters)
            frozen(one.learned if one.learned is not None else np.ones(size), (size,))
            finite = np.isfinite(one.parameters.values).all() and np.isfinite(one.covariance).all()
            if not finite or (np.diag(one.covariance) < 0.0).any():
                raise ValueError("an estimate or covariance is not finite, or a variance negative")
        return found


@dataclass(frozen=True, eq=False, repr=False)
class KnownScales:
    """Scales that a model's gains count already."""

    joints: tuple[str, ...]
    values: Array  # logged effort over that of the model, shape `(rows,)`
    covariance: Array  # of their logarithms, shape `(rows, rows)`

    def __post_init__(self) -> None:
        n = len(self.joints)
        if self.values.shape != (n,) or self.covariance.shape != (n, n):
            raise ValueError(
                f"{n} joints need {n} scales of efforts with a covariance of shape ({n}, {n})"
            )

    @property
    def half_width(self) -> Array:
        """Half-widths of the 95 % intervals, shape `(rows,)`."""
        return Z95 * np.sqrt(np.diag(self.covariance)) * self.values

    @property
    def words(self) -> str:
        """Like `joint1 0.90, joint2 1.10`."""
        return ", ".join(
            f"{name} {x:.2f}" for name, x in zip(self.joints, self.values, strict=True)
        )

    def __repr__(self) -> str:
        """Each joint's scale with its 95 % interval."""
        known = zip(self.joints, self.values, self.half_width, strict=True)
        return ", ".join(f"{joint} {x:.3f} ± {half:.2g}" for joint, x, half in known)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return {"values": self.values.tolist(), "covariance": self.covariance.tolist()}

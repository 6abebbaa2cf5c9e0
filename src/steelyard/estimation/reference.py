"""The frozen reference model of load-dependent friction, refitted until it stands still."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares import WeightedLeastSquares
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.regression.gather import gather
from steelyard.regression.regressor import base_regressor
from steelyard.robot.inertia import INERTIAL_NAMES
from steelyard.terms.load_dependent import LoadDependent

PASSES = 3
"""Most refits of the reference."""

SETTLED = 1e-3
"""Relative change of the reference's parameters at which it stands still."""


def bodies_of(estimate: Estimate) -> dict[str, float]:
    """The estimated numbers of the bodies, by name."""
    found = estimate.parameters.as_dict()
    return {name: x for name, x in found.items() if name.split(".")[0] in INERTIAL_NAMES}


def reference_of(
    model: Model, runs: Sequence[Run], gains: Array, threads: int = 1
) -> dict[str, float]:
    """Bodies fitted to runs without load-dependent friction."""
    regressor = base_regressor(model)
    said = (gather(regressor, run, threads=threads) for run in runs)
    information = reduce(add, said).scaled(gains, model.robot.effort_units)
    return bodies_of(WeightedLeastSquares()(information))


def with_references(model: Model, reference: Mapping[str, float]) -> Model:
    """The model with a reference in every load-dependent term."""
    terms = (
        term.with_reference(reference) if isinstance(term, LoadDependent) else term
        for term in model.terms
    )
    return replace(model, terms=tuple(terms))


def needs_reference(model: Model) -> bool:
    """Whether a term's load comes from a reference model."""
    return any(isinstance(term, LoadDependent) for term in model.terms)


def settled_reference(
    model: Model,
    runs: Sequence[Run],
    gains: Array,
    fit: Callable[[Model], Estimate],
    threads: int = 1,
) -> tuple[Model, Estimate, bool]:
    """Fit, take the bodies as reference, and fit again until they stand still.

    Args:
        model: A model with load-dependent friction.
        runs: What is fitted.
        gains: Joint effort per logged unit, shape `(n,)`.
        fit: The fit of a model to the runs.
        threads: Native threads.

    Returns:
        The model with its reference, its estimate, and whether the reference stands still.
    """
    plain = replace(model, terms=tuple(t for t in model.terms if not isinstance(t, LoadDependent)))
    reference = reference_of(plain, runs, gains, threads)
    for _ in range(PASSES):
        model = with_references(model, reference)
        estimate = fit(model)
        found = bodies_of(estimate)
        change = _change(reference, found)
        reference = found
        if change < SETTLED:
            return model, estimate, True
    return model, estimate, False


def _change(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    names = sorted({*before, *after})
    a, b = (np.array([values.get(name, 0.0) for name in names]) for values in (before, after))
    return float(np.linalg.norm(b - a) / max(float(np.linalg.norm(b)), 1e-300))

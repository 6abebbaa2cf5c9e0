"""The frozen reference model of load-dependent friction, refitted until it stands still."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.estimation.estimate import Estimate, Estimator
from steelyard.estimation.fields.passes import InformationOf
from steelyard.model import Model
from steelyard.regression.information import Information
from steelyard.regression.regressor import base_regressor
from steelyard.robot.inertia import INERTIAL_NAMES

PASSES = 3
"""Most refits of the reference."""

TOLERANCE = 1e-3
"""Relative change of the reference's parameters at which it stands still."""


def bodies_of(estimate: Estimate) -> dict[str, float]:
    """The estimated numbers of the bodies, by name."""
    found = estimate.parameters.as_dict()
    return {name: x for name, x in found.items() if name.split(".")[0] in INERTIAL_NAMES}


def reference_of(
    model: Model, information_of: InformationOf, estimator: Estimator[Information]
) -> dict[str, float]:
    """Bodies fitted without load-dependent friction."""
    terms = tuple(t for t in model.terms if not t.needs_reference)
    return bodies_of(estimator(information_of(base_regressor(replace(model, terms=terms)))))


def with_references(model: Model, reference: Mapping[str, float]) -> Model:
    """The model with a reference in every term that needs one."""
    return replace(model, terms=tuple(term.with_reference(reference) for term in model.terms))


def needs_reference(model: Model) -> bool:
    """Whether a term's load comes from a reference model."""
    return any(term.needs_reference for term in model.terms)


def converged_reference(
    model: Model, information_of: InformationOf, estimator: Estimator[Information]
) -> tuple[Model, bool]:
    """Fit, take the bodies as reference, and fit again until they stand still.

    Args:
        model: A model with load-dependent friction.
        information_of: What the data say about a regressor, see `fields.information_from`.
        estimator: The estimator.

    Returns:
        The model with its reference, and whether the reference stands still.
    """
    reference = reference_of(model, information_of, estimator)
    for _ in range(PASSES):
        model = with_references(model, reference)
        found = bodies_of(estimator(information_of(base_regressor(model))))
        change = _change(reference, found)
        reference = found
        if change < TOLERANCE:
            return model, True
    return model, False


def _change(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    names = sorted({*before, *after})
    a, b = (np.array([values.get(name, 0.0) for name in names]) for values in (before, after))
    return float(np.linalg.norm(b - a) / max(float(np.linalg.norm(b)), 1e-300))

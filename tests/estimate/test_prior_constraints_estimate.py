"""Knowledge reaches the estimate: every constraint holds in it, whatever the data say."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from invented import tree
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import StandardEstimate
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    base_regressor,
)
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.prior.body_priors import Knowledge, default_knowledge
from steelyard.estimate.prior.prior_constraint_kinds import KINDS, ConstraintContext
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import Inertia

MODEL = Model(tree())
NOISE = np.array([0.3, 2.0, 1.0, 0.3])
CORNERS = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]


def measured(count: int = 1200) -> Information:
    """What a motion says of the tree with half a unit of every friction, and noise."""
    rng, regressor, base = np.random.default_rng(0), base_regressor(MODEL), base_parameters(MODEL)
    truth = np.array([0.5 if p.prior is None else p.prior for p in MODEL.parameters])
    values = dict(zip(base.base_names, base.lift @ truth, strict=True))
    columns = regressor.layout.columns
    q, dq, ddq = rng.normal(size=(3, 4, count))
    effort = regressor.dense(q, dq, ddq) @ [values[name] for name in columns]
    effort = effort + NOISE[:, None] * rng.normal(size=effort.shape)
    sums = Accumulator(regressor)(Stretch(q, dq, ddq, effort))
    return Information(
        regressor.layout,
        Signature(MODEL.fingerprint, columns, ("Nm",) * 4, "none"),
        (Window("run", 0.0, 1.0),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )


INFORMATION = measured()


def knowing(*tables: Mapping[str, Any]) -> Knowledge:
    rows = [
        row
        for k, table in enumerate(tables, start=1)
        for row in KINDS.built(table, "").rows(ConstraintContext(MODEL, f"arm.toml, line {k}"))
    ]
    return replace(default_knowledge(MODEL), rows=tuple(rows), uncertainty=0.3)


def estimated(knowledge: Knowledge) -> StandardEstimate:
    standard = Consistent(base_parameters(MODEL), knowledge)(INFORMATION).standard
    assert standard is not None
    return standard


PLAIN = estimated(knowing()).parameters.as_dict()
CONSTRAINTS: list[dict[str, Any]] = [
    {"kind": "mass", "link": "tip", "value": 0.35},
    {"kind": "mass", "link": "slider", "lower": 5.0},
    {"kind": "total_mass", "lower": 20.0},
    {"kind": "centre_in_box", "link": "tip", "lower": [-0.01] * 3, "upper": [0.02] * 3},
    {"kind": "centre_in_hull", "link": "tip", "points": CORNERS},
    {"kind": "parameter", "parameter": "viscous.*", "upper": 0.45},
    {"kind": "tied", "parameter": "viscous.tip_joint", "to": "viscous.left_joint", "factor": 0.9},
    {"kind": "equal", "links": ["left", "tip"]},
    {"kind": "mirrored", "links": ["left", "tip"], "plane": "xy"},
    {"kind": "symmetric", "link": "left", "plane": "xz"},
    {"kind": "symmetric", "link": "tip", "axis": "z"},
]


@pytest.mark.parametrize("table", CONSTRAINTS, ids=[table["kind"] for table in CONSTRAINTS])
def test_the_estimate_obeys_where_the_data_alone_would_not(table: dict[str, Any]) -> None:
    knowledge = knowing(table)
    standard = estimated(knowledge)
    values, missed = standard.parameters.as_dict(), []
    for row in knowledge.rows:
        found, plain = (
            sum(a * given[name] for name, a in row.coefficients.items())
            for given in (values, PLAIN)
        )
        assert row.lower - 1e-5 <= found <= row.upper + 1e-5, row.label
        missed.append(max(row.lower - plain, plain - row.upper))
    assert max(missed) > 1e-4
    for k in range(len(knowledge.bodies)):
        ten = standard.parameters.values[knowledge.tens(k)]
        assert np.linalg.eigvalsh(Inertia.from_ten(ten).pseudo)[0] > 0.0

"""Parameters of several models in a common set; which models can be compared."""

from dataclasses import replace

import numpy as np
import pytest

from report.conftest import estimate, identified, robot
from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import ModelError
from steelyard.estimate.estimate import Estimate, Removed
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap, base_parameters
from steelyard.estimate.scores.model_comparison import (
    CommonParameter,
    common_parameters,
    refuse_different,
    same_efforts,
    units_of,
)
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.model.terms.term import Term

COVARIANCE = np.random.default_rng(1).normal(size=(60, 60))


def of(true: dict[str, float], terms: tuple[Term, ...], **more: object) -> IdentifiedModel:
    """A model that knows the base parameters of true standard ones, with correlated errors."""
    model = Model(robot(), terms)
    base = base_parameters(model)
    values = base.base_values([true[name] for name in base.names])
    part = COVARIANCE[: len(base), : len(base)]
    known = Estimate(
        "exact",
        Parameters(base.base_names, base.base_units, values),
        part @ part.T,
        (),
        np.ones(2),
        np.ones(2),
        1.0,
        1.0,
    )
    return replace(identified(robot()), model=model, base=base, estimate=replace(known, **more))


def truth(*terms: Term) -> dict[str, float]:
    model = Model(robot(), terms)
    values = np.random.default_rng(0).uniform(0.5, 2.0, len(model.names))
    return dict(zip(model.names, values.tolist(), strict=True))


def lifted(base: BaseMap, name: str, names: tuple[str, ...]) -> Array:
    """The row of a base parameter over other standard parameters."""
    row = base.lift[base.base_names.index(name)]
    place = {standard: k for k, standard in enumerate(base.names)}
    return np.array([row[place[n]] if n in place else 0.0 for n in names])


def by_name(found: tuple[CommonParameter, ...]) -> dict[str, CommonParameter]:
    return {one.name: one for one in found}


def test_another_grouping_gives_the_same_values() -> None:
    """With rotors first, they lead the groups that links lead otherwise."""
    links, rotors, viscous = RigidBody(), RotorInertia(), Viscous()
    true = truth(links, rotors, viscous)
    one, other = of(true, (links, rotors, viscous)), of(true, (rotors, links, viscous))
    assert set(one.base.base_names) != set(other.base.base_names)
    found = common_parameters([one, other])
    assert {x.name for x in found} == set(one.base.base_names) | set(other.base.base_names)
    moved = 0
    for parameter in found:
        first, second = parameter.values
        assert first.status == second.status == "identified"
        assert first.value == pytest.approx(second.value, rel=1e-9)
        owner, guest = (one, other) if parameter.name in one.base.base_names else (other, one)
        if parameter.name not in guest.base.base_names:
            moved += 1
            row = lifted(owner.base, parameter.name, guest.base.names)
            c = np.linalg.lstsq(guest.base.lift.T, row, rcond=None)[0]
            std = np.sqrt(c @ guest.estimate.covariance @ c)
            mine = second if guest is other else first
            assert mine.std == pytest.approx(std, rel=1e-9)
    assert moved > 0


def test_terms_that_a_model_lacks_are_zero_in_it() -> None:
    links, rotors, viscous = RigidBody(), RotorInertia(), Viscous()
    true = truth(links, rotors, viscous, Coulomb())
    wide, narrow = of(true, (links, rotors, viscous, Coulomb())), of(true, (links, viscous))
    found = by_name(common_parameters([narrow, wide]))
    assert found["coulomb.elbow"].values[0].status == "no such parameter"
    assert found["viscous.elbow"].values[0].value == pytest.approx(true["viscous.elbow"])
    grouped = next(
        x for x in found.values() if "rotor_inertia" in x.group and not x.name.startswith("rotor")
    )
    row = lifted(wide.base, grouped.name, narrow.base.names)
    expected = row @ [true[name] for name in narrow.base.names]
    assert grouped.values[0].value == pytest.approx(expected)
    assert grouped.values[1].value != pytest.approx(expected)


def test_removed_bound_and_blind_parameters_are_named_so() -> None:
    full = identified(robot())
    names = full.base.base_names
    base = full.base.without([names[1]])
    known = replace(estimate(base), removed=(Removed(names[1], 1, 0.2),), at_bound=(names[0],))
    found = by_name(common_parameters([full, replace(full, base=base, estimate=known)]))
    assert [x.status for x in found[names[1]].values] == ["identified", "removed"]
    assert found[names[1]].values[1].value == 0.0
    assert [x.status for x in found[names[-1]].values] == ["identified", "not identifiable"]
    assert found[names[-1]].values[1].value is None
    held = found[names[0]].values[1]
    assert held.status == "at a bound" and held.std is None
    assert held.value == pytest.approx(known.parameters.values[0])


def test_what_base_parameters_do_not_determine_has_no_value() -> None:
    """The second model keeps only one member of a group of the first."""
    true = truth(RigidBody(), Viscous())
    one = of(true, (RigidBody(), Viscous()))
    alone = replace(one.base, coefficients=np.zeros_like(one.base.coefficients))
    found = by_name(common_parameters([one, replace(one, base=alone)]))
    grouped = next(x for x in found.values() if " + " in x.group)
    assert grouped.values[1].status == "not identifiable"
    assert found["viscous.elbow"].values[1].status == "identified"


def test_models_of_other_joints_or_units_are_refused() -> None:
    first = identified(robot())
    names = ("'a'", "'b'")
    refuse_different(first, first, names)
    with pytest.raises(ModelError, match="one has the joints shoulder, elbow, the other hip"):
        refuse_different(first, identified(robot(("hip", "elbow"))), names)
    scaled = replace(first.signals, gains=np.array([1.0, 2.0]))
    relative = replace(first, signals=scaled)
    assert units_of(first) == ("Nm", "Nm") and units_of(relative) == ("A", "A")
    refuse_different(first, relative, names)
    others = replace(relative, signals=replace(scaled, effort=("c0", "c1")))
    assert same_efforts(first, relative) and not same_efforts(first, others)
    with pytest.raises(ModelError, match="in Nm, those of the other in A") as caught:
        refuse_different(first, others, names)
    assert "[signals.effort] gain" in caught.value.fix

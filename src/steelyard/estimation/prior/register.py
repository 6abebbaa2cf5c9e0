"""Prior constraints by their names in robot files; from model and robot file to knowledge."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.estimation.consistent.friction_curves import friction_curves, shaped
from steelyard.estimation.consistent.infeasibility import refuse_contradictions
from steelyard.estimation.knowledge import Knowledge, Row
from steelyard.estimation.per_run import own_columns
from steelyard.estimation.prior.body_constraints import (
    CentreInBox,
    CentreInHull,
    Equal,
    Mass,
    Mirrored,
    Symmetric,
    TotalMass,
)
from steelyard.estimation.prior.parameter_constraints import Known, Tied
from steelyard.estimation.prior.prior_constraint import ConstraintContext, PriorConstraint
from steelyard.estimation.prior.prior_given import given_knowledge
from steelyard.model import Model
from steelyard.robot.inertia import INERTIAL_NAMES
from steelyard.robot_file.described import Kinds
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.terms.register import TERMS

CONSTRAINTS: dict[str, type[Any]] = {
    constraint.kind: constraint
    for constraint in (
        Mass,
        TotalMass,
        CentreInBox,
        CentreInHull,
        Known,
        Tied,
        Equal,
        Mirrored,
        Symmetric,
    )
}

KINDS = Kinds(CONSTRAINTS, "kind", "kind of knowledge", "knowledge of kind")


def knowledge_of(model: Model, loaded: LoadedRobot, fastest: Array | None = None) -> Knowledge:
    """All that model and robot file say before the data.

    Constraints on friction that was chosen from the data, or is still to be, and is not in the
    model, are passed over with a note.

    Args:
        model: The model.
        loaded: The robot file.
        fastest: Greatest speed of each joint in the data [rad/s; m/s], up to which and beyond
            friction is bounded as a whole; without it, coefficient by coefficient.

    Raises:
        ModelError: A constraint is none, names what is not there, or contradicts itself.
        DataError: Constraints contradict each other.
    """
    known = given_knowledge(model, loaded.prior, loaded.where)
    rows: list[Row] = []
    notes = list(known.notes)
    for number, table in enumerate(loaded.knowledge):
        where = loaded.where("knowledge", number)
        constraint = constraint_of(table, where)
        if loaded.friction and (absent := _of_absent_law(constraint, model)):
            notes.append(f"the model has no '{absent}': prior constraints on it are ignored")
            continue
        mine = constraint.rows(ConstraintContext(model, where))
        _refuse_own(mine, own_columns(model), where)
        rows += mine
    lower, loosened = _loosened(known, rows)
    notes += [f"'{name}' may be below zero, as the robot file allows" for name in loosened]
    known = replace(known, lower=lower, rows=tuple(rows), notes=tuple(notes))
    refuse_contradictions(known)
    return known if fastest is None else _with_curves(known, model, fastest, loosened)


def _with_curves(
    known: Knowledge, model: Model, fastest: Array, loosened: Sequence[str]
) -> Knowledge:
    """The same with friction bounded as a whole, where the user has not set a bound lower."""
    curves = tuple(
        row for row in friction_curves(model, fastest) if not set(loosened) & set(row.coefficients)
    )
    return replace(known, curves=curves, shaped=shaped(model, curves))


def _refuse_own(rows: Sequence[Row], own: Sequence[str], where: str) -> None:
    """Refuse a constraint on what every run has for itself."""
    for name in own:
        if any(name in row.coefficients for row in rows):
            raise ModelError(
                f"every run has a '{name}' of its own, which no prior constraint can act on",
                where=where,
                fix="remove the constraint, or remove per_run from the term",
            )


def constraint_of(table: Mapping[str, Any], where: str) -> PriorConstraint:
    """A constraint from a table with its `kind` and its fields.

    Args:
        table: As the robot file has it.
        where: For messages.

    Raises:
        ModelError: There is no such kind, a field is missing or unknown, or of another type.
    """
    return cast(PriorConstraint, KINDS.built(table, where))


def _of_absent_law(constraint: PriorConstraint, model: Model) -> str | None:
    """The parameter of a friction law that the model lacks, if a constraint names one."""
    if not isinstance(constraint, Known | Tied):
        return None
    names = (
        (constraint.parameter, constraint.to)
        if isinstance(constraint, Tied)
        else (constraint.parameter,)
    )
    absent = tuple(set(TERMS) - {term.law for term in model.terms})
    return next((name for name in names if name.startswith(absent)), None)


def _loosened(known: Knowledge, rows: list[Row]) -> tuple[Array, list[str]]:
    """Lower bounds with those of laws that the user sets lower, and the names of these."""
    lower, place = np.array(known.lower), {name: k for k, name in enumerate(known.names)}
    bodies = {f"{kind}.{name}" for kind in INERTIAL_NAMES for name in known.bodies}
    loosened = []
    for row in rows:
        if len(row.coefficients) != 1 or not np.isfinite(row.lower):
            continue
        name = next(iter(row.coefficients))
        if name not in bodies and row.lower < lower[place[name]]:
            lower[place[name]] = row.lower
            loosened.append(name)
    return lower, loosened

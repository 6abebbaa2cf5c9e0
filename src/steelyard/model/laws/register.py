"""All terms by the names they have in files."""

import dataclasses
from collections.abc import Mapping
from typing import Any, cast

from steelyard.base.errors import ModelError
from steelyard.model.laws import friction_over_speed as over_speed
from steelyard.model.laws import friction_with_memory as with_memory
from steelyard.model.laws import laws_without_friction as without_friction
from steelyard.model.terms.axes_and_fields import Find, finds_of, is_search, search_of
from steelyard.model.terms.stateful_terms import Presliding
from steelyard.model.terms.term import ActsOnAxes, StatefulTerm, Term, columns_at_rest
from steelyard.robot.file.tables_by_kind import Kinds, at_place
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.robot import Robot

REQUIRED = ("dissipation", "cause", "shown_by", "in_model_files")
"""What has no default, as any default would be wrong for some law."""


def complete(law: type[Term]) -> type[Term]:
    """The law, if all is known of it that other rooms ask for; else `TypeError`."""
    names = {field.name for field in dataclasses.fields(cast(Any, law))}
    flaws = [] if "law" in vars(law) else ["lacks 'law'"]
    flaws += [f"lacks '{name}'" for name in REQUIRED if not hasattr(law, name)]
    flaws += [f"lacks '{name}'" for name in sorted(law.__abstractmethods__)]
    flaws += [f"'{name}' of `bounds` is no field" for name in law.bounds if name not in names]
    if issubclass(law, StatefulTerm):
        state_only_fields = getattr(law, "state_only_fields", None)
        if not issubclass(law, Presliding):
            flaws.append("has memory, but is no `Presliding`: the virtual robot cannot step it")
        flaws += ["lacks 'aside'"] if state_only_fields is None else []
        flaws += [
            f"'{name}' of `state_only_fields` is no field"
            for name in state_only_fields or ()
            if name not in names
        ]
    elif hasattr(law, "remember"):
        flaws.append("has memory, but is no `StatefulTerm`")
    if law.needs_reference != ("reference" in names):
        flaws.append("has a field 'reference' without `needs_reference`, or the other way round")
    if getattr(law, "dissipation", "none") != "none":
        if getattr(law, "cause", "friction") != "friction":
            flaws.append("dissipates, but is no friction")
        if not issubclass(law, ActsOnAxes):
            flaws.append("is friction, but does not act along coordinates (`ActsOnAxes`)")
    if flaws:
        raise TypeError(f"law {law.__name__}: {'; '.join(flaws)}")
    return law


TERMS: dict[str, type[Any]] = {
    law.law: complete(law)
    for law in (
        without_friction.RigidBody,
        without_friction.RotorInertia,
        over_speed.Coulomb,
        over_speed.Viscous,
        without_friction.Offset,
        over_speed.DirectionalCoulomb,
        over_speed.DirectionalViscous,
        over_speed.Quadratic,
        over_speed.Cubic,
        over_speed.Root,
        over_speed.Stribeck,
        over_speed.DirectionalStribeck,
        over_speed.Coupled,
        with_memory.LoadDependent,
        with_memory.Dahl,
        with_memory.MaxwellSlip,
        with_memory.LuGre,
        without_friction.Spring,
        without_friction.PolynomialSpring,
        without_friction.Cogging,
        without_friction.GravityCompensator,
    )
}

_KINDS = Kinds(TERMS, "law", "torque term", "term")

DEFAULT_TERMS: tuple[Term, ...] = tuple(
    TERMS[law]() for law in ("rigid_body", "rotor_inertia", "coulomb", "viscous", "offset")
)


def term_of(description: str | Mapping[str, Any], where: str) -> Term:
    """A term from its name, or from a table with its name under `law` and its fields.

    It is a `ModelError` if there is no such law, or it has no such field or value.
    """
    law, given = _KINDS.fields(description, where)
    try:
        with at_place(where):
            return cast(Term, law(**{key: _field(law, key, x, where) for key, x in given.items()}))
    except TypeError:
        raise ModelError(
            f"the value of a key of term '{law.law}' is of another type",
            where=where,
            fix=f"its keys are: {', '.join(_names(law)) or 'none'}",
        ) from None


def refuse_unfit(term: Term, robot: Robot, where: str) -> None:
    """A `ModelError`, with its place in a file, if a robot lacks what a term names."""
    with at_place(where):
        term.parameters(robot)
        if isinstance(term, StatefulTerm) and not finds_of(term):
            term.warm_up(robot)
        if term.role != "body" and not finds_of(term):
            columns_at_rest(term, robot)


def description_of(term: Term) -> dict[str, Any]:
    """The table that `term_of` turns back into the term."""
    return {"law": term.law, **{x: _plain(getattr(term, x)) for x in _names(type(term))}}


def _names(law: type[Any]) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(law))


def _field(law: type[Any], name: str, given: Any, where: str) -> Any:
    """What a file says of one field: its value, or that it is to be found.

    Switches are true or false, and nothing else is: to Python, true is the number 1.
    """
    if is_search(given):
        return search_of(law, name, given, where)
    value = _value(given)
    defaults = {field.name: field.default for field in dataclasses.fields(law)}
    switch = isinstance(defaults.get(name), bool)
    parts = value if isinstance(value, tuple) else (value,)
    if isinstance(value, bool) if switch else not any(isinstance(x, bool) for x in parts):
        return value
    raise ModelError(
        f"term '{law.law}' has {name} = {value!r}",
        where=where,
        fix=f"'{name}' is true or false" if switch else f"'{name}' is neither true nor false",
    )


def _value(given: Any) -> Any:
    """What a file says, as a value that cannot be changed: lists to tuples, tables to pairs."""
    if isinstance(given, Mapping):
        return tuple((key, _value(x)) for key, x in given.items())
    return tuple(_value(x) for x in given) if isinstance(given, list | tuple) else given


def _plain(value: Any) -> Any:
    """The inverse: tuples of named pairs to tables, other tuples to lists, terms to theirs."""
    if isinstance(value, Find):
        return value.description
    if dataclasses.is_dataclass(value):
        return description_of(cast(Term, value))
    if not isinstance(value, tuple):
        return value
    if value and all(isinstance(x, tuple) and len(x) == 2 and isinstance(x[0], str) for x in value):
        return {key: _plain(x) for key, x in value}
    return [_plain(x) for x in value]


def law_of(parameter: str) -> type[Term]:
    """The law that a standard parameter belongs to by its name; a `KeyError` if to none."""
    kind = parameter.partition(".")[0]
    if kind in INERTIAL_NAMES:
        return without_friction.RigidBody
    return TERMS[max((law for law in TERMS if kind.startswith(law)), key=len, default=kind)]

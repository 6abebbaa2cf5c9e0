"""Coupled friction: one joint's motion loads another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from steelyard.base.arrays import Parameter
from steelyard.base.errors import ModelError
from steelyard.model.equations.inverse_dynamics import JointState, Scalar
from steelyard.model.terms.axes import (
    Axis,
    Field,
    directions,
    is_zero,
    named_axis,
    refuse_negative,
    refuse_unknown,
    spread,
    unfit,
)
from steelyard.model.terms.term import Cause, Columns, Dissipation, Place, Term, left_out
from steelyard.robot.robot import Robot

Pair = tuple[tuple[str, str], tuple[str, str]]  # `(("from", name), ("to", name))`


@dataclass(frozen=True)
class Coupled(Term):
    r"""Coupled friction, $f_b = f_{ab}\,v_a$ or $f_{ab}\,s(v_a)$: belts, cables, shared bearings.

    A coupling alone may give energy; only with the joints' own friction is the whole dissipative.
    """

    law: ClassVar[str] = "coupled"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "separate motion of the joints"
    in_model_files: ClassVar[Place] = left_out("friction of one joint that loads another")
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"smoothing": (1e-3, 1.0)}
    # joints or motors, `{"from": a, "to": b}`: `b` is loaded when `a` moves
    pairs: tuple[Pair, ...] = ()
    kind: str = "viscous"  # `viscous` or `coulomb`
    # speed $w$ of $s = \tanh(v/w)$, one for all or one per pair [rad/s; m/s]; zero for the sign. Of
    # Coulomb couplings only
    smoothing: Field = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", _pairs(self.pairs))
        refuse_unknown(self.law, "kind", self.kind, ("viscous", "coulomb"))
        refuse_negative(self.law, smoothing=self.smoothing)
        if not self.pairs:
            raise _no_pair("no pairs")
        if self.kind == "viscous" and not is_zero(self.smoothing):
            raise unfit(
                "viscous coupled friction has no smoothing",
                'leave out `smoothing`, or give kind = "coulomb"',
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per pair, of either sign."""
        return tuple(
            Parameter(
                f"{self.law}_{self.kind}.{mover.name}>{loaded.name}",
                loaded.effort_unit
                if self.kind == "coulomb"
                else loaded.unit(f"{{force}}/({mover.speed_unit})"),
            )
            for mover, loaded in self._axes(robot)
        )

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The moving joint's velocity or direction, along the loaded joint."""
        pairs = self._axes(robot)
        movers = [mover for mover, _ in pairs]
        speeds: list[Scalar] = (
            directions(movers, state.dq, self.smoothing, self.law)
            if self.kind == "coulomb"
            else [mover.of(state.dq) for mover in movers]
        )
        return spread([loaded for _, loaded in pairs], speeds)

    def _axes(self, robot: Robot) -> list[tuple[Axis, Axis]]:
        return [
            (named_axis(robot, mover), named_axis(robot, loaded))
            for (_, mover), (_, loaded) in self.pairs
        ]


def _pairs(given: Any) -> tuple[Pair, ...]:
    """All pairs; one alone may come without a list."""
    table = dict(given) if isinstance(given, Mapping) else None
    if isinstance(given, tuple) and all(isinstance(x, tuple) and len(x) == 2 for x in given):
        table = {key: value for key, value in given if isinstance(key, str)}
    if table is not None and set(table) == {"from", "to"}:
        return (_pair(table),)
    if not isinstance(given, tuple | list):
        raise _no_pair(f"pairs = {given!r}")
    return tuple(_pair(pair) for pair in given)


def _pair(given: Mapping[str, str] | Sequence[Any]) -> Pair:
    """A pair in its one form, from a table, named pairs, or two names."""
    try:
        if isinstance(given, Sequence) and all(isinstance(name, str) for name in given):
            mover, loaded = given
        else:
            table = dict(given)
            mover, loaded = table.pop("from"), table.pop("to")
            if table:
                raise ValueError
    except (TypeError, ValueError, KeyError):
        raise _no_pair(f"the pair {given!r}") from None
    if isinstance(given, str) or mover == loaded or not isinstance(mover, str):
        raise _no_pair(f"the pair {given!r}")
    return ("from", mover), ("to", loaded)


def _no_pair(what: str) -> ModelError:
    return unfit(
        f"coupled friction with {what}",
        'name two joints or motors per pair: pairs = [{from = "hip", to = "knee"}]',
    )

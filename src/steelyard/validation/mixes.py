"""Mixes of friction laws: candidates of `friction = "auto"`, stage by stage, and their names."""

from collections.abc import Sequence
from dataclasses import fields

from steelyard.terms.coulomb import Coulomb
from steelyard.terms.load_dependent import LoadDependent
from steelyard.terms.powers import Cubic, Quadratic, Root
from steelyard.terms.presliding import Dahl, LuGre, MaxwellSlip
from steelyard.terms.stribeck import Stribeck
from steelyard.terms.term import Remembering, Term
from steelyard.terms.viscous import Viscous

FINE = (3e-4, 1e-3, 3e-3, 1e-2)
WIDE = (1e-3, 4e-3, 2e-2, 1e-1)

DIRECTION: tuple[tuple[Term, ...], ...] = (
    (Coulomb(),),
    *((Coulomb(smoothing=speed),) for speed in (0.005, 0.02, 0.05)),
    *((Dahl(length=length),) for length in (3e-4, 1e-3, 3e-3, 1e-2)),
    *(
        (LuGre(length=length, breakaway=1.15, speed=speed),)
        for length in (3e-4, 1e-3)
        for speed in (0.1, 0.3)
    ),
    (MaxwellSlip(lengths=FINE),),
    (MaxwellSlip(lengths=WIDE, relaxing=True),),
    (Coulomb(), MaxwellSlip(lengths=FINE)),
)
"""How friction turns round with the direction of motion, the simplest first."""

SPEED: tuple[tuple[Term, ...], ...] = (
    (Viscous(),),
    (Viscous(), Root()),
    (Viscous(), Quadratic()),
    (Viscous(), Cubic()),
    *((Viscous(), Stribeck(speed=speed)) for speed in (0.02, 0.1)),
)
"""How friction grows with speed."""

LOADED = ("motor_current", "motor_torque")
"""Kinds of effort that gears stand behind: their friction grows with the load."""

LOAD: tuple[tuple[Term, ...], ...] = ((), (LoadDependent(length=1e-3),))
"""Whether friction grows with the load."""

STAGES = (DIRECTION, SPEED, LOAD)


def remembers(terms: Sequence[Term]) -> bool:
    """Whether friction at rest is known: some law has a memory of where the joint came from."""
    return any(isinstance(term, Remembering) for term in terms)


def mix_name(terms: Sequence[Term]) -> str:
    """A mix for people to read: laws with their speeds and lengths, and what else is not usual."""
    return " + ".join(_term_name(term) for term in terms)


def _term_name(term: Term) -> str:
    told = {f.name: getattr(term, f.name) for f in fields(term)}  # type: ignore[arg-type]
    usual = {f.name: f.default for f in fields(term)}  # type: ignore[arg-type]
    always = getattr(term, "bounds", {})
    given = [
        f"{name} {_short(value)}"
        for name, value in told.items()
        if name not in HIDDEN and value and (name in always or value != usual[name])
    ]
    return f"{term.law} ({', '.join(given)})" if given else term.law


HIDDEN = ("reference", "joints", "per_run")
"""Fields that no name holds."""


def _short(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(_short(x) for x in value)
    return f"{value:g}" if isinstance(value, float) else str(value)

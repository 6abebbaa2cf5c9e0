"""Cases of laws: all tests and proofs that run over laws take theirs from here.

Fields name places of any robot: `@joint 1` is the name of its second joint, `@motor 0` and
`@link 0` likewise.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from steelyard.model.laws.register import DEFAULT_TERMS, description_of, term_of
from steelyard.model.terms.term import StatefulTerm, Term
from steelyard.robot.robot import Robot

FIT = "nonlinear friction curve; fitted by"


@dataclass(frozen=True, eq=False)
class LawCase:
    """A law with values of its fields, and what is true of it.

    Attributes:
        law: The law's name.
        fields: Its fields.
        energy: Whether it takes energy over a closed motion, gives back what it took, or either.
        odd: Whether friction over speed is alike in both directions.
        continuous: Whether it is continuous over speed.
        left_out: What an exported MJCF lists of it; empty if that holds it whole.
        in_urdf: Whether a URDF holds it whole.
        values: Values of parameters for the export, by name.
        units: Of its first parameters, on a revolute and a prismatic joint.
        faint: Whether a free swing loses little energy by it.
        simulated: Whether the virtual robot is simulated with it: `felt` in its log, and
            `recovered` from it by `proofs/laws/laws_recover.py`.
        beside: Laws of speed beside it there.
        found: Fields that are found from exact data, with a value per joint of a robot with three.
        replaces: Customary laws whose place it takes.
    """

    law: str
    fields: Mapping[str, Any] = field(default_factory=dict)
    energy: Literal["taken", "kept", "either"] = "taken"
    odd: bool = True
    continuous: bool = True
    left_out: str = ""
    in_urdf: bool = False
    values: Mapping[str, float] = field(default_factory=dict)
    units: tuple[str, str] | None = None
    faint: bool = False
    simulated: Literal["", "felt", "recovered"] = ""
    beside: tuple[str | Mapping[str, Any], ...] = ("viscous",)
    found: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    replaces: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.law}{dict(self.fields) or ''}"

    def fits(self, robot: Robot) -> bool:
        """Whether the robot has the places that the fields name."""
        try:
            self.on(robot)
        except IndexError:
            return False
        return True

    def on(self, robot: Robot, **changed: Any) -> Term:
        """The law on a robot, some of its fields changed."""
        return term_of({"law": self.law, **_placed({**self.fields, **changed}, robot)}, "test")

    def other_terms(self) -> tuple[Term, ...]:
        """The customary terms but those whose place it takes."""
        return tuple(term for term in DEFAULT_TERMS if term.law not in self.replaces)


def _placed(value: Any, robot: Robot) -> Any:
    if isinstance(value, Mapping):
        return {_placed(key, robot): _placed(x, robot) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(_placed(x, robot) for x in value)
    if not isinstance(value, str) or not value.startswith("@"):
        return value
    kind, _, number = value[1:].partition(" ")
    motors = () if robot.transmission is None else robot.transmission.motors
    names = {"joint": robot.joint_names, "link": [b.name for b in robot.bodies], "motor": motors}
    return names[kind][int(number)]


CHOSEN = ["@joint 1", "@joint 3"]
WRIST = {"wrist": {"@joint 2": 1.0, "@joint 3": -2.0}}
ARM = {"arm": {"@joint 0": 1.0, "@joint 3": -2.0}}
SLIDE = {"slide": {"@joint 1": 1.0}, **ARM}
FORK = {"fork": {"@joint 2": 1.0, "@joint 3": 1.0}}
FIRST, LAST, OUTER = (["@motor 0", "@motor 1"], ["@motor 2", "@motor 3"], ["@motor 0", "@motor 3"])
PULL, PUSH = ({"from": "@joint 0", "to": "@joint 1"}, {"from": "@motor 3", "to": "@joint 2"})
ENDS = [[0.3, -0.4, 1.2], [0.1, 0.2, 0.0]]
NEAR = [[0.0, 0.0, 0.1], [0.0, 0.05, 0.2]]
TURN = {"law": "coulomb", "smoothing": 0.02}
NM, RATE = ("Nm", "N"), ("N m s/rad", "N s/m")
LENGTHS, SPEEDS = (3e-4, 1e-3, 1e-2), (0.02, 0.05, 0.2)
MEMORY: dict[str, Any] = {"left_out": "presliding displacement", "replaces": ("coulomb",)}
NAMED: dict[str, Any] = {"energy": "kept", "odd": False}

CASES: tuple[LawCase, ...] = (
    LawCase("rigid_body", **NAMED),
    LawCase("rotor_inertia", **NAMED, units=("kg m²", "kg"), simulated="recovered"),
    LawCase("rotor_inertia", {"motors": LAST}, **NAMED, left_out="rotor inertia:"),
    LawCase("rotor_inertia", {"motors": FIRST}, **NAMED),
    LawCase("rotor_inertia", {"along": SLIDE}, **NAMED),
    LawCase("rotor_inertia", {"along": FORK}, **NAMED, left_out="rotor inertia: fork"),
    LawCase("coulomb", continuous=False, in_urdf=True, units=NM, simulated="recovered"),
    LawCase("coulomb", {"along": SLIDE}, continuous=False),
    LawCase("coulomb", {"motors": LAST}, continuous=False),
    LawCase(
        "coulomb", {"threshold": 0.02}, continuous=False, left_out="begins above",
        simulated="recovered",
    ),
    LawCase(
        "coulomb", {"threshold": [0.1, 0.2], "motors": LAST}, continuous=False,
        left_out="begins above",
    ),
    LawCase(
        "coulomb", {"smoothing": 0.05}, left_out="turns smoothly within", simulated="recovered",
        found={"smoothing": (0.02, 0.05, 0.01)}, replaces=("coulomb",),
    ),
    LawCase("coulomb", {"smoothing": 0.2, "joints": CHOSEN}, left_out="turns smoothly within"),
    LawCase(
        "coulomb", {"smoothing": [0.05, 0.1, 0.2, 0.3], "shape": "arctan"},
        left_out="turns smoothly within",
    ),
    LawCase(
        "coulomb", {"smoothing": 0.3, "shape": "logistic"}, left_out="turns smoothly within",
        simulated="felt",
    ),
    LawCase("viscous", in_urdf=True, units=RATE, simulated="recovered", beside=()),
    LawCase("viscous", {"joints": CHOSEN}, in_urdf=True),
    LawCase("viscous", {"threshold": 0.1}, continuous=False, left_out="begins above"),
    LawCase("viscous", {"motors": LAST}),
    LawCase("viscous", {"per_run": True}, left_out="single runs"),
    LawCase(
        "offset", **NAMED, left_out="(offset)", units=NM, simulated="recovered",
    ),
    LawCase("offset", {"joints": CHOSEN}, **NAMED, left_out="(offset)"),
    LawCase(
        "directional_coulomb", odd=False, continuous=False, left_out="their mean", units=NM,
        simulated="recovered",
    ),
    LawCase(
        "directional_coulomb", {"smoothing": 10.0, "motors": OUTER}, odd=False,
        left_out="their mean",
    ),
    LawCase(
        "directional_coulomb", {"smoothing": [0.05, 0.3], "shape": "arctan", "joints": CHOSEN},
        odd=False, left_out="their mean",
    ),
    LawCase(
        "directional_coulomb", {"smoothing": 0.05}, odd=False, left_out="their mean",
        found={"smoothing": (0.02, 0.05, 0.01)}, replaces=("coulomb", "offset"),
    ),
    LawCase(
        "directional_viscous", odd=False, left_out="their mean", units=RATE,
        simulated="recovered", beside=(),
    ),
    LawCase("directional_viscous", {"joints": CHOSEN}, odd=False, left_out="their mean"),
    LawCase("quadratic", units=("N m/(rad/s)²", "N/(m/s)²"), simulated="recovered"),
    LawCase("quadratic", {"motors": ["@motor 1", "@motor 3"]}),
    LawCase("cubic", units=("N m/(rad/s)³", "N/(m/s)³"), simulated="recovered"),
    LawCase("cubic", {"along": SLIDE}),
    LawCase("root", left_out=FIT, units=("N m/√(rad/s)", "N/√(m/s)"), simulated="recovered"),
    LawCase(
        "stribeck", continuous=False, left_out=FIT, units=NM, faint=True, simulated="felt",
        found={"speed": SPEEDS},
    ),
    LawCase("stribeck", {"speed": 0.3, "smoothing": 0.02}, left_out=FIT),
    LawCase(
        "stribeck", {"speed": 0.2, "smoothing": 0.02}, left_out=FIT, simulated="recovered",
        beside=(TURN, "viscous"),
    ),
    LawCase(
        "stribeck", {"speed": 0.2, "smoothing": 0.02, "shape": "arctan"}, left_out=FIT,
        simulated="recovered", beside=({**TURN, "shape": "arctan"}, "viscous"),
        found={"speed": SPEEDS, "smoothing": (0.02, 0.05, 0.01)},
    ),
    LawCase(
        "stribeck", {"smoothing": [0.05, 0.3], "shape": "logistic", "joints": CHOSEN},
        left_out=FIT,
    ),
    LawCase(
        "stribeck", {"speed": [30.0, 50.0], "exponent": 2, "smoothing": 8.0, "motors": LAST},
        left_out=FIT,
    ),
    LawCase(
        "stribeck", {"speed": [0.4, 0.6], "exponent": 2, "joints": CHOSEN}, continuous=False,
        left_out=FIT,
    ),
    LawCase(
        "directional_stribeck", odd=False, continuous=False, left_out="their mean", units=NM,
        faint=True, simulated="felt", found={"speed": SPEEDS},
    ),
    LawCase(
        "directional_stribeck", {"speed": 0.2, "smoothing": 0.02}, odd=False,
        left_out="their mean", simulated="recovered",
        beside=({"law": "directional_coulomb", "smoothing": 0.02}, "viscous"),
    ),
    LawCase(
        "directional_stribeck", {"speed": 0.2, "smoothing": 0.02, "shape": "arctan"}, odd=False,
        left_out="their mean", found={"smoothing": (0.02, 0.05, 0.01)},
    ),
    LawCase(
        "directional_stribeck",
        {"speed": [30.0, 50.0], "exponent": 2, "smoothing": 8.0, "motors": LAST}, odd=False,
        left_out=FIT,
    ),
    LawCase("coupled", {"pairs": [PULL, PUSH]}, energy="either", left_out="(coupled)"),
    LawCase(
        "coupled", {"pairs": [PULL]}, energy="either", left_out="(coupled)",
        simulated="recovered",
    ),
    LawCase(
        "coupled", {"pairs": [PULL], "kind": "coulomb"}, energy="either", continuous=False,
        left_out="(coupled)", simulated="recovered",
    ),
    LawCase(
        "coupled", {"pairs": [PULL, PUSH], "kind": "coulomb", "smoothing": [0.3, 3.0]},
        energy="either", left_out="(coupled)",
    ),
    LawCase(
        "load_dependent", odd=False, left_out="(load_dependent)", units=("1", "1"), faint=True,
        simulated="recovered", found={"length": LENGTHS},
    ),
    LawCase(
        "load_dependent",
        {"length": 0.02, "reference": {"m.tip": 2.0, "mz.tip": 0.3}, "motors": ["@motor 3"]},
        odd=False, left_out="(load_dependent)",
    ),
    LawCase("dahl", **MEMORY, units=NM, simulated="recovered", found={"length": LENGTHS}),
    LawCase("dahl", {"length": [0.02, 0.03], "joints": CHOSEN}, **MEMORY),
    LawCase("dahl", {"length": 1.0, "motors": LAST}, **MEMORY),
    LawCase("maxwell_slip", **MEMORY, units=NM, simulated="recovered"),
    LawCase("maxwell_slip", {"relaxing": True}, **MEMORY, simulated="felt"),
    LawCase(
        "maxwell_slip", {"lengths": [0.01, 0.1], "relaxing": True, "joints": CHOSEN}, **MEMORY
    ),
    LawCase("lugre", **MEMORY, units=NM, simulated="recovered"),
    LawCase(
        "lugre", {"length": 0.01, "speed": 0.2, "breakaway": 1.6}, **MEMORY,
        found={"length": LENGTHS, "speed": SPEEDS},
    ),
    LawCase(
        "lugre",
        {"length": [0.01, 0.02], "breakaway": 2.0, "speed": 0.5,
         "along": {**WRIST, "x": {"@joint 2": 1.0}}},
        **MEMORY,
    ),
    LawCase("spring", **NAMED, units=("N m/rad", "N/m"), simulated="recovered"),
    LawCase("spring", {"free": [0.3, -0.2], "joints": CHOSEN}, **NAMED),
    LawCase("spring", {"free": -1.0, "along": SLIDE}, **NAMED),
    LawCase("spring", {"free": "unknown"}, **NAMED, simulated="recovered"),
    LawCase("spring", {"free": "unknown", "motors": ["@motor 1", "@motor 3"]}, **NAMED),
    LawCase(
        "polynomial_spring", **NAMED, left_out="(polynomial_spring)",
        units=("N m/rad²", "N/m²"), simulated="recovered",
    ),
    LawCase("polynomial_spring", {"along": SLIDE}, **NAMED, left_out="(polynomial_spring)"),
    LawCase("cogging", **NAMED, left_out="(cogging)", units=NM, simulated="recovered"),
    LawCase("cogging", {"period": [0.9, 0.4], "joints": CHOSEN}, **NAMED, left_out="(cogging)"),
    LawCase("cogging", {"period": 60.0, "motors": LAST}, **NAMED, left_out="(cogging)"),
    LawCase("gravity_compensator", {"links": ["base", "tool"], "points": ENDS}, **NAMED),
    LawCase(
        "gravity_compensator", {"links": ["base", "tool"], "points": ENDS, "name": "pushing"},
        **NAMED, left_out="spring between 'base' and",
        values={"gravity_compensator_preload.pushing": -2.0},
    ),
    LawCase(
        "gravity_compensator",
        {"links": ["@link 2", "@link 1"], "points": ENDS, "name": "second"}, **NAMED,
    ),
    LawCase(
        "gravity_compensator", {"links": ["@link 0", "@link 1"], "points": NEAR}, **NAMED,
        simulated="recovered",
    ),
)  # fmt: skip


def simulated(robot: Robot, recovered: bool = False) -> list[LawCase]:
    """The cases that the virtual robot is simulated with, or that are recovered from its log."""
    wanted = ("recovered",) if recovered else ("felt", "recovered")
    return [case for case in CASES if case.simulated in wanted and case.fits(robot)]


def spanning(cases: Iterable[LawCase] = CASES) -> list[LawCase]:
    """The first cases that together have every law and every name of a field.

    For what laws inherit or have from their programs, such as slopes.
    """
    kept, seen = [], set[str]()
    for case in cases:
        new = {case.law, *case.fields} - seen
        kept += [case] if new else []
        seen |= new
    return kept


def memoryless(robot: Robot, cases: Iterable[LawCase] = CASES) -> list[Term]:
    """The laws whose columns a single sample tells."""
    return [x for case in cases if not isinstance(x := case.on(robot), StatefulTerm)]


def name_of(of: Any) -> str:
    """A case or a term in the names of tests."""
    return str(description_of(of)) if isinstance(of, Term) else str(of)

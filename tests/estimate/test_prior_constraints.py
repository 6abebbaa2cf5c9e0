"""Knowledge as rows: they hold for robots that are so, fail for others; what cannot be is named."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from invented import ball, tree
from steelyard.base.errors import DataError, ModelError
from steelyard.estimate.consistent.prior_weight_and_contradictions import (
    contradictions,
    irreducible,
    refuse_contradictions,
)
from steelyard.estimate.prior.body_priors import Knowledge, Row, default_knowledge
from steelyard.estimate.prior.prior_constraint_kinds import (
    CONSTRAINTS,
    KINDS,
    ConstraintContext,
    knowledge_of,
)
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.register import DEFAULT_TERMS, term_of
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Frame

MODEL = Model(
    tree().changed(
        frames=(
            Frame("cover", 2, np.eye(3), np.zeros(3)),
            Frame("pedestal", -1, np.eye(3), np.zeros(3)),
        )
    )
)
BODY = {body.name: body.inertia for body in MODEL.robot.bodies}
HULL = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3]]
CUBE = [[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)]
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def parameters(bodies: Mapping[str, Inertia], **others: float) -> dict[str, float]:
    """All standard parameters: bodies by name, others at 1 unless given as `law_joint`."""
    values = {name: 1.0 for name in MODEL.names}
    for name, inertia in {**BODY, **bodies}.items():
        kinds = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
        values |= {f"{kind}.{name}": x for kind, x in zip(kinds, inertia.ten, strict=True)}
    return values | {f"{name.replace('__', '.')}": x for name, x in others.items()}


def rows(table: Mapping[str, Any]) -> list[Row]:
    return KINDS.built(table, "arm.toml, line 3").rows(ConstraintContext(MODEL, "arm.toml, line 3"))


def holds(constraints: Sequence[Row], values: Mapping[str, float]) -> bool:
    def of(row: Row) -> float:
        return sum(a * values[name] for name, a in row.coefficients.items())

    return all(row.lower - 1e-12 <= of(row) <= row.upper + 1e-12 for row in constraints)


def at(com: Sequence[float], mass: float = 2.0) -> Inertia:
    return Inertia.about_com(mass, com, ball(5).inertia_com)


def flipped(inertia: Inertia, signs: Sequence[float]) -> Inertia:
    """The mirror image, by the mirror itself."""
    mirror = np.diag([*signs, 1.0])
    return Inertia.from_pseudo(mirror @ inertia.pseudo @ mirror.T)


def plus(*bodies: Inertia) -> Inertia:
    return sum(bodies, Inertia.zero())


def around_z() -> Inertia:
    """A body that is alike after every quarter turn about z."""
    turned, total = ball(5), Inertia.zero()
    for _ in range(4):
        turned, total = turned.moved(TURN, np.zeros(3)), total + turned
    return total


TOTAL = sum(body.mass for body in BODY.values())
CASES: list[tuple[dict[str, Any], dict[str, float], dict[str, float]]] = [
    (
        {"kind": "mass", "link": "tip", "lower": 1.5, "upper": 2},
        parameters({"tip": at((0, 0, 0), 1.9)}),
        parameters({"tip": at((0, 0, 0), 2.1)}),
    ),
    (
        {"kind": "mass", "link": "tip", "value": 2.0},
        parameters({"tip": at((0, 0, 0))}),
        parameters({"tip": at((0, 0, 0), 1.99)}),
    ),
    (
        {"kind": "total_mass", "lower": TOTAL - 0.1},
        parameters({}),
        parameters({"tip": at((0, 0, 0), BODY["tip"].mass - 0.2)}),
    ),
    (
        {"kind": "total_mass", "links": ["tip", "left"], "upper": 3.0},
        parameters({"tip": at((0, 0, 0), 1.0), "left": at((0, 0, 0), 1.9)}),
        parameters({"tip": at((0, 0, 0), 1.0), "left": at((0, 0, 0), 2.1)}),
    ),
    (
        {"kind": "centre_in_box", "link": "tip", "lower": [-1, -0.1, 0], "upper": [1, 0.2, 1]},
        parameters({"tip": at((0.9, 0.15, 0.1))}),
        parameters({"tip": at((0.9, 0.25, 0.1))}),
    ),
    (
        {"kind": "centre_in_box", "link": "tip", "lower": [0.1, 0, 0], "upper": [0.1, 0.2, 1]},
        parameters({"tip": at((0.1, 0.15, 0.1))}),
        parameters({"tip": at((0.09, 0.15, 0.1))}),
    ),
    (
        {"kind": "centre_in_hull", "link": "tip", "points": HULL},
        parameters({"tip": at((0.09, 0.09, 0.09), 0.3)}),
        parameters({"tip": at((0.11, 0.11, 0.11), 0.3)}),
    ),
    (
        {"kind": "centre_in_hull", "link": "tip", "points": CUBE},
        parameters({"tip": at((0.09, -0.09, 0.09))}),
        parameters({"tip": at((0.09, -0.11, 0.09))}),
    ),
    (
        {"kind": "parameter", "parameter": "viscous.tip_joint", "upper": 2.0},
        parameters({}, viscous__tip_joint=1.9),
        parameters({}, viscous__tip_joint=2.1),
    ),
    (
        {"kind": "parameter", "parameter": "viscous.*", "lower": 0.5},
        parameters({}, viscous__tip_joint=0.6),
        parameters({}, viscous__left_joint=0.4),
    ),
    (
        {"kind": "parameter", "parameter": "rotor_inertia.tip_joint", "value": 0.3},
        parameters({}, rotor_inertia__tip_joint=0.3),
        parameters({}, rotor_inertia__tip_joint=0.31),
    ),
    (
        {
            "kind": "tied",
            "parameter": "coulomb.tip_joint",
            "to": "coulomb.left_joint",
            "factor": 0.5,
        },
        parameters({}, coulomb__tip_joint=2.0, coulomb__left_joint=4.0),
        parameters({}, coulomb__tip_joint=2.0, coulomb__left_joint=1.0),
    ),
    (
        {"kind": "equal", "links": ["tip", "left", "slider"]},
        parameters({"tip": ball(7), "left": ball(7), "slider": ball(7)}),
        parameters({"tip": ball(7), "left": ball(7), "slider": ball(8)}),
    ),
    *(
        (
            {"kind": "mirrored", "links": ["tip", "left"], "plane": plane},
            parameters({"tip": ball(7), "left": flipped(ball(7), signs)}),
            parameters({"tip": ball(7), "left": ball(7)}),
        )
        for plane, signs in (("xy", (1, 1, -1)), ("xz", (1, -1, 1)), ("yz", (-1, 1, 1)))
    ),
    *(
        (
            {"kind": "symmetric", "link": "tip", "plane": plane},
            parameters({"tip": plus(ball(7), flipped(ball(7), signs))}),
            parameters({"tip": ball(7)}),
        )
        for plane, signs in (("xy", (1, 1, -1)), ("xz", (1, -1, 1)), ("yz", (-1, 1, 1)))
    ),
    (
        {"kind": "symmetric", "link": "tip", "axis": "z"},
        parameters({"tip": around_z()}),
        parameters({"tip": plus(ball(7), flipped(ball(7), (-1, -1, 1)))}),
    ),
]


@pytest.mark.parametrize(
    ("table", "so", "not_so"), CASES, ids=[f"{t['kind']}-{k}" for k, (t, *_) in enumerate(CASES)]
)
def test_rows_hold_where_the_constraint_does(
    table: dict[str, Any], so: dict[str, float], not_so: dict[str, float]
) -> None:
    constraints = rows(table)
    assert constraints and holds(constraints, so)
    assert not holds(constraints, not_so)
    assert all("(arm.toml, line 3)" in row.label for row in constraints)
    assert all(set(row.coefficients) <= set(MODEL.names) for row in constraints)


def test_every_kind_has_a_case() -> None:
    assert {table["kind"] for table, *_ in CASES} == set(CONSTRAINTS)


def test_facets_of_a_cube_are_six() -> None:
    assert len(rows({"kind": "centre_in_hull", "link": "tip", "points": CUBE})) == 6


@pytest.mark.parametrize(
    ("table", "label"),
    [
        ({"kind": "mass", "link": "tip", "lower": 3}, "the mass of link 'tip' is at least 3 kg"),
        (
            {"kind": "total_mass", "lower": 3, "upper": 5},
            "the total mass of all links is between 3 and 5 kg",
        ),
        (
            {"kind": "total_mass", "upper": 5, "links": ["tip", "left"]},
            "the total mass of 'tip', 'left' is at most 5 kg",
        ),
        (
            {"kind": "parameter", "parameter": "viscous.slider_joint", "value": 3.0},
            "'viscous.slider_joint' is 3 N s/m",
        ),
        (
            {"kind": "symmetric", "link": "tip", "plane": "xz"},
            "link 'tip' is symmetric about its xz plane",
        ),
        (
            {"kind": "tied", "parameter": "m.tip", "to": "m.left", "factor": 2},
            "'m.tip' is 2 times 'm.left'",
        ),
    ],
)
def test_labels_say_the_constraint_in_words(table: dict[str, Any], label: str) -> None:
    assert rows(table)[0].label == f"{label} (arm.toml, line 3)"


HALF = {"kind": "centre_in_box", "link": "tip", "lower": [0, 0, 0]}
MISTAKES: list[tuple[dict[str, Any], str, str]] = [
    ({"link": "tip"}, "does not name its kind", "the kinds are mass, total_mass"),
    ({"kind": "mas", "link": "tip"}, "'mas' is no kind of knowledge", "did you mean 'mass'"),
    ({"kind": "mass", "lower": 1}, "needs 'link'", "add link = ..."),
    ({"kind": "mass", "link": "tip", "lowr": 1}, "does not understand 'lowr'", "'lower'"),
    ({"kind": "mass", "link": 3, "lower": 1}, "3 cannot be used for 'link'", "string"),
    ({"kind": "mass", "link": "tip", "lower": True}, "True cannot be used", "number"),
    ({"kind": "mass", "link": "tip", "lower": float("nan")}, "nan cannot be used", "finite"),
    ({"kind": "equal", "links": "tip"}, "'tip' cannot be used for 'links'", "list in [ ]"),
    ({"kind": "mirrored", "links": ["tip", "left"], "plane": "zz"}, "'zz' cannot", "'xy', 'xz'"),
    (
        {**HALF, "upper": [1, 1]},
        "[1, 1] cannot be used for 'upper'",
        "give three numbers, [x, y, z]",
    ),
    ({"kind": "mass", "link": "tpi", "lower": 1}, "no moving link 'tpi'", "did you mean 'tip'"),
    (
        {"kind": "mass", "link": "cover", "lower": 1},
        "'cover' moves with link 'left'",
        "name 'left'",
    ),
    ({"kind": "mass", "link": "pedestal", "lower": 1}, "'pedestal' does not move", "moving links"),
    ({"kind": "mass", "link": "tip"}, "neither value nor bounds", "give value = ..."),
    ({"kind": "mass", "link": "tip", "value": 1, "lower": 1}, "a value and bounds", "give value"),
    ({"kind": "mass", "link": "tip", "lower": 2, "upper": 1}, "lower bound 2 is above", "exchange"),
    ({"kind": "total_mass", "links": [], "lower": 2}, "but no link", "name links"),
    ({**HALF, "upper": [1, -1, 1]}, "the box's lower y is 0, its upper one -1", "exchange"),
    (
        {"kind": "centre_in_hull", "link": "tip", "points": HULL[:3]},
        "the 3 points of link 'tip' span no volume",
        "four points or more",
    ),
    (
        {"kind": "centre_in_hull", "link": "tip", "points": [*HULL[:3], [0.1, 0.1, 0.0]]},
        "the 4 points of link 'tip' span no volume",
        "not in one plane",
    ),
    (
        {"kind": "centre_in_hull", "link": "tip", "points": []},
        "the 0 points of link 'tip' span no volume",
        "four points or more",
    ),
    (
        {"kind": "parameter", "parameter": "viscous.tp_joint", "lower": 1},
        "the model has no parameter 'viscous.tp_joint'",
        "did you mean 'viscous.tip_joint'",
    ),
    ({"kind": "parameter", "parameter": "dahl.*", "lower": 1}, "no parameter 'dahl.*'", ""),
    ({"kind": "tied", "parameter": "m.tip", "to": "m.tpi"}, "no parameter 'm.tpi'", "'m.tip'"),
    ({"kind": "tied", "parameter": "m.tip", "to": "m.tip"}, "tied to itself", "another"),
    ({"kind": "equal", "links": ["tip"]}, "to be compared are tip", "two different links"),
    ({"kind": "equal", "links": ["tip", "tip"]}, "to be compared are tip, tip", "two different"),
    ({"kind": "symmetric", "link": "tip"}, "about a plane or an axis", 'plane = "xz"'),
    (
        {"kind": "symmetric", "link": "tip", "plane": "xy", "axis": "z"},
        "about a plane or an axis",
        'axis = "z"',
    ),
]


@pytest.mark.parametrize(("table", "wrong", "fix"), MISTAKES)
def test_mistakes_are_explained(table: dict[str, Any], wrong: str, fix: str) -> None:
    with pytest.raises(ModelError) as caught:
        rows(table)
    assert wrong in caught.value.wrong and fix in caught.value.fix
    assert caught.value.where == "arm.toml, line 3"


def test_bodies_without_a_rigid_body_term_are_not_there() -> None:
    scope = ConstraintContext(Model(tree(), (Viscous(),)), "arm.toml, line 3")
    with pytest.raises(ModelError, match="no mass properties of link 'tip'"):
        KINDS.built({"kind": "mass", "link": "tip", "lower": 1}, "").rows(scope)
    with pytest.raises(ModelError, match="but no link"):
        KINDS.built({"kind": "total_mass", "lower": 1}, "").rows(scope)


URDF = """<robot name="two"><link name="a"/>
<link name="b"><inertial><origin xyz="0 0 .1"/><mass value="2"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="c"><inertial><origin xyz="0 0 .1"/><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
<joint name="wrist" type="continuous"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/></joint>
</robot>"""


@pytest.fixture
def read(tmp_path: Path) -> Any:
    (tmp_path / "two.urdf").write_text(URDF)

    def robot(*knowledge: str, before: str = "") -> LoadedRobot:
        tables = "".join(f"\n[[knowledge]]\n{text}\n" for text in knowledge)
        return load_robot(tmp_path / "arm.toml", f'[robot]\nurdf = "two.urdf"\n{before}{tables}')

    return robot


def known(loaded: LoadedRobot) -> Knowledge:
    given = None if loaded.terms is None else [term.description for term in loaded.terms]
    terms = DEFAULT_TERMS if given is None else tuple(term_of(x, "terms") for x in given)
    return knowledge_of(Model(loaded.robot, terms), loaded)


def test_a_robot_file_becomes_knowledge(read: Any) -> None:
    found = known(
        read(
            'kind = "total_mass"\nlower = 2.5',
            'kind = "parameter"\nparameter = "viscous.*"\nupper = 3.0',
            before="[prior]\nuncertainty = 0.2\nlinks.c = {mass = 1.5}\n",
        )
    )
    assert [row.upper for row in found.rows] == [np.inf, 3.0, 3.0]
    assert found.rows[0].coefficients == {"m.b": 1.0, "m.c": 1.0}
    assert "arm.toml, line 7, [knowledge[1]]" in found.rows[0].label
    assert found.uncertainty == 0.2 and found.notes == ()
    assert [prior.mass for prior in found.priors if prior is not None] == [2.0, 1.5]


def test_without_sections_it_is_what_the_model_says(read: Any) -> None:
    loaded = read()
    found, plain = known(loaded), default_knowledge(Model(loaded.robot))
    assert found.rows == () and found.uncertainty is None and found.notes == plain.notes
    np.testing.assert_array_equal(found.lower, plain.lower)
    for one, other in zip(found.priors, plain.priors, strict=True):
        np.testing.assert_array_equal(one.ten, other.ten)


def test_a_lower_bound_takes_the_place_of_the_laws(read: Any) -> None:
    loaded = read('kind = "parameter"\nparameter = "viscous.elbow"\nlower = -2.0')
    found = known(loaded)
    assert found.lower[found.names.index("viscous.elbow")] == -2.0
    assert found.lower[found.names.index("viscous.wrist")] == 0.0
    assert found.notes == ("'viscous.elbow' may be below zero, as the robot file allows",)


def test_knowledge_of_friction_that_was_not_chosen_is_passed_over(read: Any) -> None:
    table = 'kind = "parameter"\nparameter = "maxwell_slip1.elbow"\nupper = 2.0'
    loaded = read(table, before='[model]\nfriction = "auto"\n')
    laws = ("rigid_body", "offset", "viscous")
    model = Model(loaded.robot, tuple(term_of(law, "terms") for law in laws))
    found = knowledge_of(model, loaded)
    assert found.rows == ()
    assert found.notes == (
        "the model has no 'maxwell_slip1.elbow': prior constraints on it are ignored",
    )
    with pytest.raises(ModelError, match=r"no parameter 'maxwell_slip1\.elbow'"):
        knowledge_of(model, read(table))


@pytest.mark.parametrize(
    "name",
    ["viscous.elbwo", "vicous.elbow", "m.d"],
)
def test_misspelt_parameters_are_found_beside_chosen_friction(read: Any, name: str) -> None:
    loaded = read(
        f'kind = "parameter"\nparameter = "{name}"\nupper = 2.0',
        before='[model]\nfriction = "auto"\n',
    )
    with pytest.raises(ModelError, match="the model has no parameter") as caught:
        knowledge_of(Model(loaded.robot), loaded)
    assert "line 6, [knowledge[1]]" in caught.value.where


CONTRADICTIONS: list[tuple[list[str], list[int]]] = [
    (
        [
            'kind = "parameter"\nparameter = "viscous.*"\nupper = 40.0',
            'kind = "total_mass"\nupper = 4.0',
            'kind = "mass"\nlink = "b"\nlower = 5.0',
            'kind = "centre_in_box"\nlink = "b"\nlower = [-1, -1, -1]\nupper = [1, 1, 1]',
        ],
        [2, 3],
    ),
    (
        [
            'kind = "equal"\nlinks = ["b", "c"]',
            'kind = "tied"\nparameter = "m.b"\nto = "m.c"\nfactor = 2',
        ],
        [1, 2],
    ),
    (
        [
            'kind = "symmetric"\nlink = "b"\naxis = "z"',
            'kind = "equal"\nlinks = ["b", "c"]',
            'kind = "centre_in_box"\nlink = "c"\nlower = [0.1, -1, -1]\nupper = [1, 1, 1]',
        ],
        [1, 2, 3],
    ),
    (
        [
            'kind = "parameter"\nparameter = "Ixx.b"\nlower = 2.0',
            'kind = "parameter"\nparameter = "Iyy.b"\nupper = 0.9',
            'kind = "parameter"\nparameter = "Izz.b"\nupper = 1.0',
        ],
        [1, 2, 3],
    ),
    (
        [
            'kind = "parameter"\nparameter = "Ixy.b"\nlower = 2.0',
            'kind = "parameter"\nparameter = "Izz.b"\nupper = 3.9',
        ],
        [1, 2],
    ),
    (  # a centre 1 m away makes 1 kg m² about the origin: no row says so, only the cone
        [
            'kind = "mass"\nlink = "b"\nlower = 1.0',
            'kind = "mass"\nlink = "c"\nlower = 1.0',
            'kind = "centre_in_box"\nlink = "b"\nlower = [1, -1, -1]\nupper = [2, 1, 1]',
            'kind = "parameter"\nparameter = "Izz.b"\nupper = 0.99',
        ],
        [1, 3, 4],
    ),
]


def test_what_nearly_cannot_be_still_can(read: Any) -> None:
    known(
        read(
            'kind = "mass"\nlink = "b"\nvalue = 1.0',
            'kind = "centre_in_box"\nlink = "b"\nlower = [1, -1, -1]\nupper = [2, 1, 1]',
            'kind = "parameter"\nparameter = "Izz.b"\nupper = 1.001',
        )
    )


@pytest.mark.parametrize(("knowledge", "guilty"), CONTRADICTIONS)
def test_contradictions_are_named(read: Any, knowledge: list[str], guilty: list[int]) -> None:
    with pytest.raises(DataError) as caught:
        known(read(*knowledge))
    assert caught.value.wrong.startswith("these constraints are infeasible together: ")
    named = [k for k in range(1, 9) if f"[knowledge[{k}]]" in caught.value.wrong]
    assert named == guilty
    assert caught.value.fix == "correct one of them, or leave it out"
    for left_out in guilty:
        known(read(*(x for k, x in enumerate(knowledge, start=1) if k != left_out)))


def test_a_constraint_that_no_body_fulfils_is_named(read: Any) -> None:
    with pytest.raises(
        DataError, match="no physical body satisfies this: the mass of link 'b' is at most 0 kg"
    ):
        known(read('kind = "mass"\nlink = "b"\nupper = 0.0'))
    with pytest.raises(DataError, match=r"no physical body satisfies this: 'Izz\.c' is -1 kg m²"):
        known(read('kind = "parameter"\nparameter = "Izz.c"\nvalue = -1.0'))


def test_bounds_of_laws_are_named(read: Any) -> None:
    with pytest.raises(DataError) as caught:
        known(read('kind = "parameter"\nparameter = "coulomb.elbow"\nupper = -1.0'))
    assert "'coulomb.elbow' is at least 0 by its law; 'coulomb.elbow' is at most -1" in str(
        caught.value
    )


def test_bodies_that_exist_are_never_refused() -> None:
    found = default_knowledge(MODEL)
    fixed = tuple(
        Row(name, {name: 1.0}, value, value)
        for name, value in parameters({}).items()
        if not name.startswith("offset")
    )
    assert contradictions(replace(found, rows=fixed)) == ()
    refuse_contradictions(replace(found, rows=fixed))
    impossible = tuple(
        replace(row, lower=10.0, upper=10.0) if row.label == "Ixx.tip" else row for row in fixed
    )
    assert {"Ixx.tip"} < set(contradictions(replace(found, rows=impossible)))


@pytest.mark.parametrize("seed", range(10))
def test_what_is_true_of_other_bodies_is_never_refused(seed: int) -> None:
    truth = {name: ball(100 + 10 * seed + k) for k, name in enumerate(BODY)}
    tables: list[dict[str, Any]] = []
    for name, body in truth.items():
        corner = {"lower": (body.com - 1e-3).tolist(), "upper": (body.com + 1e-3).tolist()}
        tables += [
            {"kind": "mass", "link": name, "value": body.mass},
            {"kind": "centre_in_box", "link": name, **corner},
            {"kind": "parameter", "parameter": f"Ixx.{name}", "upper": 1.01 * body.ten[4]},
            {"kind": "parameter", "parameter": f"Izz.{name}", "lower": 0.99 * body.ten[9]},
        ]
    constraints = tuple(row for table in tables for row in rows(table))
    assert holds(constraints, parameters(truth))
    assert contradictions(replace(default_knowledge(MODEL), rows=constraints)) == ()
    # half of what the centre alone makes
    name, body = "left", truth["left"]
    least = body.mass * (body.com[0] ** 2 + body.com[1] ** 2)
    tight = {"kind": "parameter", "parameter": f"Izz.{name}", "upper": 0.5 * least}
    labels = contradictions(replace(default_knowledge(MODEL), rows=(*constraints, *rows(tight))))
    assert any(f"'Izz.{name}' is at most" in label for label in labels) and len(labels) <= 3


def room(rows: Sequence[Row]) -> bool:
    """Whether rows over single parameters can hold."""
    lower, upper = ({x: sign * np.inf for x in "xy"} for sign in (-1, 1))
    for row in rows:
        (name,) = row.coefficients
        lower[name], upper[name] = max(lower[name], row.lower), min(upper[name], row.upper)
    return all(lower[name] <= upper[name] for name in lower)


def test_an_irreducible_set_keeps_the_rows_of_a_constraint_together() -> None:
    constraints = [
        Row("small", {"x": 1.0}, upper=1.0),
        Row("both large", {"x": 1.0}, lower=2.0),
        Row("both large", {"y": 1.0}, lower=2.0),
        Row("harmless", {"y": 1.0}, lower=0.0),
    ]
    assert irreducible(constraints, room) == tuple(constraints[:3])
    assert irreducible(constraints, lambda rows: False) == ()


def test_an_irreducible_set_is_found_in_few_questions() -> None:
    constraints = [Row(str(k), {"x": 1.0}, lower=float(k % 5 == 3)) for k in range(64)]
    constraints[40] = Row("40", {"x": 1.0}, upper=-1.0)
    calls = 0

    def feasible(some: tuple[Row, ...]) -> bool:
        nonlocal calls
        calls += 1
        return room(some)

    found = irreducible(constraints, feasible)
    assert len(found) == 2 and constraints[40] in found
    assert not room(found) and all(room([row]) for row in found)
    assert calls < 30


def test_contradictions_of_many_constraints_are_found_quickly() -> None:
    links = list(BODY)
    tables = [{"kind": "equal", "links": links}]
    tables += [{"kind": "centre_in_hull", "link": link, "points": CUBE} for link in links]
    tables += [{"kind": "mass", "link": link, "lower": 1.0 + k} for k, link in enumerate(links)]
    tables += [{"kind": "total_mass", "upper": 10.0}]
    everything = tuple(row for table in tables for row in rows(table))
    start = time.process_time()
    labels = contradictions(replace(default_knowledge(MODEL), rows=everything))
    assert time.process_time() - start < 5.0
    assert [label.split(" (")[0] for label in labels] == [
        "links 'trunk', 'slider', 'left', 'tip' are equal",
        "the mass of link 'tip' is at least 4 kg",
        "the total mass of all links is at most 10 kg",
    ]

"""Priors of bodies: corrected, replaced, given; always possible, never silently changed."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from invented import ball, single, tree
from steelyard.base.errors import ModelError
from steelyard.estimate.prior import body_priors as prior_shapes
from steelyard.estimate.prior.body_priors import (
    THINNEST,
    Knowledge,
    corrected_body,
    default_knowledge,
    given_knowledge,
)
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.sections import PriorSection
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Body, Robot

EXAMPLES = Path(__file__).parents[2] / "examples"
DATA = os.environ.get("STEELYARD_DATA")
needs_data = pytest.mark.skipif(not DATA, reason="STEELYARD_DATA names no folder with robots")


def with_bodies(*bodies: tuple[Inertia, bool]) -> Robot:
    """The tree, its first bodies with other mass properties."""
    robot = tree()
    changed = [
        Body(**{**vars(body), "inertia": inertia, "known": known})
        for body, (inertia, known) in zip(robot.bodies, bodies, strict=False)
    ]
    return robot.changed(bodies=(*changed, *robot.bodies[len(changed) :]))


def moments(inertia: Inertia) -> Any:
    return np.linalg.eigvalsh(prior_shapes.spread_of(inertia))


def possible(known: Knowledge) -> bool:
    return all(p is None or np.linalg.eigvalsh(p.pseudo)[0] > 0.0 for p in known.priors)


def given(text: dict[str, Any], robot: Robot | None = None) -> Knowledge:
    section = PriorSection.model_validate(text)
    model = Model(tree() if robot is None else robot)
    return given_knowledge(model, section, lambda *key: f"arm.toml, {'.'.join(map(str, key))}")


def test_a_capsule_has_the_moments_of_its_slices() -> None:
    length, radius, mass = 0.4, 0.08, 3.0
    z = np.linspace(-0.5 * length - radius, 0.5 * length + radius, 200_001)
    beyond = np.maximum(np.abs(z) - 0.5 * length, 0.0)
    area = radius**2 - beyond**2
    along = mass * np.sum(area * z**2) / np.sum(area)
    across = mass * np.sum(area * area / 4.0) / np.sum(area)
    solid = prior_shapes.capsule(mass, (0.0, 0.05, -0.2), (0.0, 0.05, 0.2), radius)
    np.testing.assert_allclose(solid.com, (0.0, 0.05, 0.0), atol=1e-15)
    spread = prior_shapes.spread_of(solid)
    np.testing.assert_allclose(spread, np.diag([across, across, along]), rtol=1e-6, atol=1e-12)
    askew = prior_shapes.capsule(mass, (0.0, 0.0, 0.0), (0.0, 0.24, 0.32), radius)
    np.testing.assert_allclose(moments(askew), [across, across, along], rtol=1e-6)


def test_a_box_and_a_ball_have_the_moments_of_textbooks() -> None:
    solid = prior_shapes.box(6.0, (0.1, 0.2, 0.3), (0.2, 0.3, 0.4))
    wanted = 0.5 * np.array([0.3**2 + 0.4**2, 0.2**2 + 0.4**2, 0.2**2 + 0.3**2])
    np.testing.assert_allclose(solid.inertia_com, np.diag(wanted), atol=1e-12)
    np.testing.assert_allclose(solid.com, (0.1, 0.2, 0.3))
    round_one = prior_shapes.ball(2.0, (0.0, 0.0, 0.0), 0.1)
    np.testing.assert_allclose(round_one.inertia_com, 0.4 * 2.0 * 0.01 * np.eye(3))
    no_rod = prior_shapes.capsule(2.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.1)
    np.testing.assert_allclose(no_rod.ten, round_one.ten)


def test_stand_ins_have_the_density_of_links() -> None:
    radius = np.sqrt(5.0 * moments(prior_shapes.ball(4.0, np.zeros(3)))[0] / 4.0)
    assert 4.0 / (4.0 / 3.0 * np.pi * radius**3) == pytest.approx(prior_shapes.DENSITY)
    slim = prior_shapes.capsule(4.0, np.zeros(3), (0.0, 0.0, 0.5))
    heavy = prior_shapes.capsule(8.0, np.zeros(3), (0.0, 0.0, 0.5))
    assert moments(heavy)[0] / 8.0 > moments(slim)[0] / 4.0


def test_good_bodies_stay_as_they_are() -> None:
    known = default_knowledge(Model(tree()))
    for prior, body in zip(known.priors, tree().bodies, strict=True):
        assert prior is not None
        np.testing.assert_array_equal(prior.ten, body.inertia.ten)
    assert known.notes == ()
    model = Model(tree())
    assert known.names == model.names
    assert known.lower[model.names.index("viscous.tip_joint")] == 0.0
    assert known.lower[model.names.index("offset.tip_joint")] == -np.inf


def test_an_impossible_body_keeps_mass_centre_and_axes() -> None:
    broken = Inertia.about_com(2.0, (0.1, 0.0, 0.2), np.diag([0.01, 0.01, 0.05]))
    corrected = corrected_body(broken)
    assert corrected.inertia.mass == 2.0
    np.testing.assert_allclose(corrected.inertia.com, (0.1, 0.0, 0.2))
    np.testing.assert_allclose(moments(corrected.inertia), [0.025 * THINNEST, 0.025, 0.025])
    (note,) = default_knowledge(Model(with_bodies((broken, True)))).notes
    assert note.startswith("the prior of link 'trunk': its moments of inertia are raised to 0.0252")
    assert "0.01 + 0.01 < 0.05" not in note  # the model file's own note has that
    assert "it is not physically consistent: " in str(
        corrected.why
    ) and "0.01 + 0.01 < 0.05" in str(corrected.why)


def test_a_thin_body_is_widened_and_its_moments_hardly_change() -> None:
    plate = prior_shapes.box(1.0, (0.0, 0.0, 0.1), (0.4, 0.3, 1e-3))
    corrected = corrected_body(plate)
    assert corrected.thin
    change = np.linalg.eigvalsh(corrected.inertia.inertia_com) - np.linalg.eigvalsh(
        plate.inertia_com
    )
    assert 0.0 < np.abs(change).max() <= 2.0 * THINNEST * moments(plate)[-1]
    notes = default_knowledge(Model(with_bodies((plate, True), (plate, True)))).notes
    assert notes == (
        "priors of links thinner than 10% of their length were widened: 'trunk', 'slider'",
    )


def test_links_with_the_same_stand_in_share_a_note() -> None:
    missing = (Inertia.zero(), False)
    (note,) = default_knowledge(Model(with_bodies(missing, missing))).notes
    assert note.startswith("the prior of links 'trunk', 'slider': the model file gives no mass")


def test_a_point_mass_becomes_a_sphere() -> None:
    point = Inertia.about_com(1.9, (0.013, -0.027, 0.131), np.zeros((3, 3)))
    why = corrected_body(point).why
    assert why == (
        "its moments of inertia are zero; a solid sphere of 1.9 kg about its centre of mass is "
        "assumed"
    )


@pytest.mark.parametrize(
    ("inertia", "known", "words"),
    [
        (Inertia.zero(), False, "the model file gives no mass properties; a solid body of"),
        (Inertia.zero(), True, "its mass is zero; a solid body of"),
        (Inertia(0.0, np.zeros(3), 0.1 * np.eye(3)), True, "its mass is zero; a solid body of"),
        (Inertia(-2.0, np.zeros(3), np.eye(3)), True, "its mass is negative (-2 kg); a solid"),
        (Inertia(2.0, (np.nan, 0, 0), np.eye(3)), True, "a value is not finite; a solid body of"),
    ],
)
def test_bodies_without_mass_get_a_stand_in(inertia: Inertia, known: bool, words: str) -> None:
    robot = with_bodies((inertia, known))
    found = default_knowledge(Model(robot))
    assert possible(found)
    (note,) = found.notes
    assert note.startswith("the prior of link 'trunk': ") and words in note
    least = min(body.inertia.mass for body in robot.bodies[1:])
    assert found.priors[0] is not None
    assert found.priors[0].mass == pytest.approx(least)
    # two bodies hang on the trunk: half of the mass lies between its origin and each
    ends = np.mean([body.position for body in robot.bodies if body.parent == 0], axis=0)
    np.testing.assert_allclose(found.priors[0].com, ends / 2.0)


def test_a_point_mass_becomes_a_ball_about_its_centre() -> None:
    point = Inertia.about_com(0.2, (0.0, 0.0, 0.03), np.zeros((3, 3)))
    known = default_knowledge(Model(with_bodies((point, True))))
    assert known.priors[0] is not None
    np.testing.assert_allclose(known.priors[0].com, (0.0, 0.0, 0.03))
    assert moments(known.priors[0])[0] > 0.0
    assert "its moments of inertia are zero; a solid sphere of 0.2 kg" in known.notes[0]
    dense = Inertia.about_com(5.0, np.zeros(3), 1e-6 * np.eye(3))
    assert "denser than steel" in str(corrected_body(dense).why)


def test_a_robot_without_any_mass_is_a_kilogram_a_link() -> None:
    hinge = single().bodies[0]
    bare = Body(**{**vars(hinge), "inertia": Inertia.zero(), "known": False})
    known = default_knowledge(Model(single().changed(bodies=(bare,))))
    assert known.priors[0] is not None and known.priors[0].mass == 1.0
    assert possible(known) and "1 kg" in known.notes[0]


def test_without_rigid_bodies_there_are_no_priors() -> None:
    known = default_knowledge(Model(tree(), (Viscous(),)))
    assert known.bodies == () and known.priors == () and len(known.names) == 4


@needs_data
@pytest.mark.parametrize("name", ["ur10e", "panda", "rokae_ar5", "tiago", "tx40"])
def test_priors_of_real_robots_are_possible(name: str) -> None:
    robot = load_robot(EXAMPLES / f"{name}.toml").robot
    known = default_knowledge(Model(robot))
    assert possible(known) and len(known.priors) == len(robot.bodies)
    for prior, body in zip(known.priors, robot.bodies, strict=True):
        assert prior is not None and prior.flaw() is None
        assert prior.mass == pytest.approx(body.inertia.mass)
        np.testing.assert_allclose(prior.com, body.inertia.com, atol=1e-12)
        spread = moments(prior)
        assert spread[0] >= 0.999 * THINNEST * spread[-1]


@needs_data
@pytest.mark.parametrize(
    ("name", "link", "words"),
    [
        ("tx40", "link_6", "its moments of inertia are zero"),
        ("panda", "panda_link2", "were widened"),
        ("tiago", "arm_1_link", "its moments of inertia are raised to"),
    ],
)
def test_notes_name_the_links_of_real_robots(name: str, link: str, words: str) -> None:
    known = default_knowledge(Model(load_robot(EXAMPLES / f"{name}.toml").robot))
    assert any(f"'{link}'" in note and words in note for note in known.notes)
    assert not default_knowledge(Model(load_robot(EXAMPLES / "ur10e.toml").robot)).notes


def test_masses_of_cad_scale_the_models_bodies() -> None:
    known = given({"links": {"left": {"mass": 9.0}}, "uncertainty": 0.3})
    body = tree().bodies[2].inertia
    assert known.priors[2] is not None
    np.testing.assert_allclose(known.priors[2].ten, body.ten * 9.0 / body.mass)
    assert known.uncertainty == 0.3 and known.notes == ()


def test_cad_bodies_boxes_and_capsules_replace_the_models() -> None:
    known = given(
        {
            "links": {
                "trunk": {"mass": 2.0, "com": (0, 0, 0.1), "inertia_com": (0.1, 0, 0.1, 0, 0, 0.1)},
                "slider": {"mass": 6.0, "box": {"size": (0.2, 0.3, 0.4), "centre": (0.1, 0, 0)}},
                "left": {"mass": 3.0, "capsule": {"end": (0, 0, 0.3), "radius": 0.05}},
                "tip": {"com": (0.0, 0.0, 0.5)},
            }
        }
    )
    wanted = (
        Inertia.about_com(2.0, (0, 0, 0.1), 0.1 * np.eye(3)),
        prior_shapes.box(6.0, (0.1, 0, 0), (0.2, 0.3, 0.4)),
        prior_shapes.capsule(3.0, np.zeros(3), (0, 0, 0.3), 0.05),
        Inertia.about_com(ball(3).mass, (0, 0, 0.5), ball(3).inertia_com),
    )
    for prior, body in zip(known.priors, wanted, strict=True):
        assert prior is not None
        np.testing.assert_allclose(prior.ten, body.ten, atol=1e-12)


def test_nothing_may_be_known() -> None:
    assert given({"source": "none"}).priors == (None,) * 4
    known = given({"source": "none", "links": {"tip": {"mass": 1.0}}})
    assert [p is None for p in known.priors] == [True, True, True, False]
    known = given({"links": {"tip": {"source": "none"}}})
    assert [p is None for p in known.priors] == [False, False, False, True]
    known = given({"source": "none", "links": {"tip": {"source": "model"}}})
    assert known.priors[3] is not None
    np.testing.assert_array_equal(known.priors[3].ten, tree().bodies[3].inertia.ten)


def test_a_box_of_unknown_mass_takes_a_mass_and_says_so() -> None:
    robot = with_bodies((Inertia.zero(), False))
    known = given({"links": {"trunk": {"box": {"size": (0.1, 0.1, 0.1)}}}}, robot)
    assert known.priors[0] is not None
    assert known.priors[0].mass == min(body.inertia.mass for body in robot.bodies[1:])
    assert known.notes[0].startswith("the prior of link 'trunk': its mass is not known; ")


def test_given_bodies_are_corrected_too() -> None:
    impossible = {"mass": 2.0, "com": (0, 0, 0), "inertia_com": (0.01, 0, 0.01, 0, 0, 0.05)}
    known = given({"links": {"tip": impossible}})
    assert possible(known)
    assert "the prior of link 'tip': it is not physically consistent" in known.notes[0]


@pytest.mark.parametrize(
    ("links", "wrong", "fix"),
    [
        ({"tpi": {"mass": 1.0}}, "no moving link 'tpi'", "did you mean 'tip'"),
        ({"tip": {}}, "the prior of link 'tip'", "give mass"),
        ({"tip": {"source": "none", "mass": 1.0}}, "none, but properties are given", "leave out"),
        (
            {"tip": {"box": {"size": (1, 1, 1)}, "capsule": {"end": (0, 0, 1), "radius": 1.0}}},
            "has box and capsule at once",
            "keep one",
        ),
        (
            {"tip": {"box": {"size": (1, 1, 1)}, "com": (0, 0, 0)}},
            "has box and com at once",
            "keep one",
        ),
    ],
)
def test_unclear_priors_are_refused(links: dict[str, Any], wrong: str, fix: str) -> None:
    with pytest.raises(ModelError) as caught:
        given({"links": links})
    assert wrong in caught.value.wrong and fix in caught.value.fix
    assert caught.value.where == f"arm.toml, prior.links.{next(iter(links))}"

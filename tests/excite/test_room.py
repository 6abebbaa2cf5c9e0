"""Floor, planes and boxes for all that a robot moves: margins by coal, proofs by dense sampling."""

from pathlib import Path

import numpy as np
import pytest

from closed_chains import five_bar
from excite.colliding import ARM_WITHOUT, distances, link, postures, ur10, urdf, waves, written
from excite.tabled import OPEN, arm, model_with_open_friction, problem_of, some_motion
from steelyard.base.errors import ModelError
from steelyard.excite.collision.clearance import Clearance
from steelyard.excite.collision.solids_and_shapes import Ball, Box, Capsule
from steelyard.excite.collision.workspace_from_tables import WALL_RESERVE, WALLS_NAME, up_of
from steelyard.excite.constraints.certificate import certify
from steelyard.excite.constraints.constraint_and_limits import Declined, Gap
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.file.robot_file import load_robot
from steelyard.simulate.simulate import _above_table, write_demo_arm

ANY = f'{OPEN}[excitation.limits]\neffort = "any"\n[excitation.workspace]\n'
WALLS = """floor = -0.1
planes = [{normal = [0.0, 3.0, 4.0], above = -2.0}]
keep_out = [{x = [0.4, 0.7], y = [-0.2, 0.3], z = [0.0, 0.5]}]
"""


def room(folder: Path, tables: str) -> Clearance:
    """The constraint of tables."""
    (found,) = [c for c in problem_of(folder, ANY + tables).constraints if c.name == WALLS_NAME]
    return found


def test_margins_are_distances_by_coal(tmp_path: Path) -> None:
    found = room(tmp_path, WALLS)
    q = postures(found.robot, 40)
    still = np.zeros_like(q)
    values = found.margins(q, still, still).values + WALL_RESERVE
    for k, pair in enumerate(found.pairs):
        apart = [distances(found.robot, found.scene.shapes, way, q) for way in pair.shapes]
        expected = np.min(apart, axis=0)
        near = expected < 0.04
        np.testing.assert_allclose(values[near, k], expected[near], atol=2e-6)
        assert np.all(values[~near, k] > 0.035)


def test_walls_are_where_the_tables_have_them(tmp_path: Path) -> None:
    shapes = {shape.name: shape for shape in room(tmp_path, WALLS).scene.shapes}
    np.testing.assert_allclose(shapes["floor"].position, [0.0, 0.0, -0.1])
    plane = shapes["plane 1"]
    np.testing.assert_allclose(plane.rotation[:, 2], [0.0, 0.6, 0.8])
    assert plane.position @ np.array([0.0, 3.0, 4.0]) == pytest.approx(-2.0)
    box = shapes["forbidden box 1"]
    np.testing.assert_allclose(box.position, [0.55, 0.05, 0.25])
    assert isinstance(box.solid, Box)
    np.testing.assert_allclose(box.solid.size, [0.3, 0.5, 0.5])


def test_all_links_and_the_tool_are_kept_off_every_wall(tmp_path: Path) -> None:
    pairs = {(pair.first, pair.second) for pair in room(tmp_path, WALLS).pairs}
    walls = ("plane 1", "forbidden box 1")
    things = ("tower", "boom", "stick", "tool", "tool point at tool")
    assert pairs >= {(thing, wall) for thing in things for wall in walls}
    assert {thing for thing, wall in pairs if wall == "floor"} == set(things)


def test_the_tool_alone_if_that_is_requested(tmp_path: Path) -> None:
    constraints = problem_of(tmp_path, ANY + WALLS + "only_tool = true\n").constraints
    (whole,) = [c for c in constraints if c.name == WALLS_NAME]
    assert {pair.second for pair in whole.pairs} == {"floor"}
    others = {c.name: c.scope for c in constraints if c.name != WALLS_NAME}
    assert others == {"planes": "tool point only", "forbidden boxes": "tool point only"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_proofs_hold_and_are_near(tmp_path: Path, seed: int) -> None:
    found = room(tmp_path, WALLS + "radius = 0.04\npoint = [0.1, 0.0, 0.05]\n")
    motion = waves(found.robot, seed)
    proven = found.proven(motion)
    t = np.linspace(0.0, motion.duration, 20_000)
    q = motion.derivative(t, 0)
    sampled = found.margins(q, q, q).values.min(axis=0)
    assert np.all(proven <= np.maximum(sampled, proven * (sampled >= 0.05)))
    near = sampled < 0.04
    assert near.any() and np.all(sampled[near] - proven[near] < 3e-4)


def test_a_margin_has_its_slope(tmp_path: Path) -> None:
    found = room(tmp_path, WALLS)
    q = postures(found.robot, 60, seed=4)
    margins, step = found.margins(q, q, q), 1e-6
    for j in range(found.robot.n):
        more, less = (found.margins(q + s * step * np.eye(3)[j], q, q).values for s in (1, -1))
        near = (np.abs(margins.values) < 0.03) & (np.abs(more - less) < 4.0 * step)
        change = (more - less) / (2.0 * step)
        wrong = np.abs(margins.by_q[:, :, j] - change)[near] > 1e-3
        assert near.sum() > 10 and wrong.mean() < 0.05  # where two faces are alike it has two


def test_what_the_base_carries_is_left_out_and_named(tmp_path: Path) -> None:
    notes = problem_of(tmp_path, f"{ANY}floor = 0.0\n").notes
    (line,) = [note for note in notes if "the base does not move" in note]
    assert line.endswith("links: base") and not isinstance(line, Gap)


def test_a_floor_without_gravity_is_a_gap(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, f"{ANY}floor = -0.2\n")
    assert not [note for note in problem.notes if "no gravity is declared" in note]
    text = (tmp_path / "arm.toml").read_text().replace("[robot]", "[robot]\ngravity = [0, 0, 0]")
    floating = load_robot(written(tmp_path, text, "floating.toml"))
    notes = build(floating, model_with_open_friction(floating)).notes
    (line,) = [note for note in notes if "no gravity is declared" in note]
    assert isinstance(line, Gap) and "normal to z" in line


def test_a_link_that_no_joint_brings_out_of_a_wall_is_a_gap(tmp_path: Path) -> None:
    tables = f"{ANY}floor = 0.13\n"
    notes = problem_of(tmp_path, tables).notes
    (line,) = [note for note in notes if "outside the workspace limits" in note]
    assert isinstance(line, Gap) and "tower in floor by 10 mm" in line
    assert not any("tower" in label for label in room(tmp_path, "floor = 0.13\n").labels)


BARE = ARM_WITHOUT


def bare(folder: Path, tables: str = "floor = 0.0\n", text: str = BARE) -> Clearance:
    """The constraint of an arm without collision shapes."""
    written(folder, text)
    head = '[robot]\nurdf = "arm.urdf"\n[model]\nterms = ["rigid_body"]\n'
    loaded = load_robot(written(folder, head + ANY + tables, "bare.toml"))
    (found,) = [
        c
        for c in build(loaded, model_with_open_friction(loaded)).constraints
        if c.name == WALLS_NAME
    ]
    return found


def test_links_without_shapes_are_capsules_from_joint_to_joint(tmp_path: Path) -> None:
    found = bare(tmp_path)
    shapes = {s.name: s for s in found.scene.shapes if s.origin == "link"}
    assert set(shapes) == {"tower", "boom", "stick"}
    boom = shapes["boom"]
    assert isinstance(boom.solid, Capsule)
    assert boom.solid.length == pytest.approx(0.3)
    np.testing.assert_allclose(boom.position, [0.15, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.abs(boom.rotation[:, 2]), [1.0, 0.0, 0.0], atol=1e-12)
    stick = shapes["stick"]
    assert isinstance(stick.solid, Capsule)
    assert stick.solid.length == pytest.approx(np.hypot(0.35, 0.02))


def test_assumed_capsules_are_a_gap_with_their_radius(tmp_path: Path) -> None:
    found = bare(tmp_path)
    boom = next(s.solid for s in found.scene.shapes if s.name == "boom")
    assert isinstance(boom, Capsule)
    problem = build(
        load_robot(tmp_path / "bare.toml"),
        model_with_open_friction(load_robot(tmp_path / "bare.toml")),
    )
    (line,) = [note for note in problem.notes if "limits use capsules" in note]
    assert isinstance(line, Gap) and f"boom ({1e3 * boom.disc:.3g} mm)" in line


def test_the_radius_is_that_of_the_even_cylinder(tmp_path: Path) -> None:
    wide, long, mass = 0.05, 0.3, 2.0
    along, across = 0.5 * mass * wide**2, mass * (3 * wide**2 + long**2) / 12.0
    own = f'<mass value="{mass}"/><inertia ixx="{along}" ixy="0" ixz="0" iyy="{across}"'
    own += f' iyz="0" izz="{across}"/></inertial></link>'
    head, _, rest = BARE.partition('<link name="boom"><inertial>')
    rest = rest.partition("</link>")[2]
    found = bare(tmp_path, text=f'{head}<link name="boom"><inertial>{own}{rest}')
    boom = next(s.solid for s in found.scene.shapes if s.name == "boom")
    assert isinstance(boom, Capsule) and boom.disc == pytest.approx(wide)


def test_visual_shapes_come_before_assumed_ones(tmp_path: Path) -> None:
    drawn = '<visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual></link>'
    text = BARE.replace("</link>", drawn, 3)
    found = bare(tmp_path, text=text)
    solids = {s.name: s.solid for s in found.scene.shapes if s.origin == "link"}
    assert isinstance(solids["tower"], Box) and isinstance(solids["stick"], Capsule)
    loaded = load_robot(tmp_path / "bare.toml")
    notes = build(loaded, model_with_open_friction(loaded)).notes
    (line,) = [note for note in notes if "visual" in note]
    assert line.endswith("tower, boom") and not isinstance(line, Gap)


def test_a_mesh_that_is_not_there_leaves_a_capsule(tmp_path: Path) -> None:
    mesh = '<collision><geometry><mesh filename="no.stl"/></geometry></collision></link>'
    found = bare(tmp_path, text=BARE.replace("</link>", mesh))
    assert {type(s.solid) for s in found.scene.shapes if s.origin == "link"} == {Capsule}


def test_a_table_of_dh_parameters_has_capsules(tmp_path: Path) -> None:
    rows = "links = [{d = 0.3, alpha = 1.5708}, {a = 0.4}, {a = 0.3}]"
    file = f'[robot.dh]\nconvention = "standard"\n{rows}\n{ANY}floor = -0.2\n'
    file += "point = [0.3, 0.0, 0.0]\n"
    loaded = load_robot(written(tmp_path, file, "dh.toml"))
    (found,) = [
        c
        for c in build(loaded, model_with_open_friction(loaded)).constraints
        if c.name == WALLS_NAME
    ]
    rods = {s.name: s.solid for s in found.scene.shapes if isinstance(s.solid, Capsule)}
    lengths = {name: rod.length for name, rod in rods.items()}
    assert lengths == pytest.approx({"link_2": 0.4, "link_3": 0.3, "tool point at link_3": 0.3})
    assert rods["link_2"].disc == rods["link_3"].disc == pytest.approx(0.05 * 0.7)


def test_loads_are_balls_of_water_or_of_their_radius(tmp_path: Path) -> None:
    loads = "[[excitation.loads]]\nmass = 5.0\ncom = [0.0, 0.0, 0.1]\n"
    found = room(tmp_path, f"floor = 0.0\n{loads}{loads}radius = 0.2\n")
    balls = {s.name: s.solid.radius for s in found.scene.shapes if isinstance(s.solid, Ball)}
    assert balls["load 1 (ball of radius 106 mm)"] == pytest.approx(
        (15e-3 / (4 * np.pi)) ** (1 / 3)
    )
    assert balls["load 2 (ball of radius 200 mm)"] == 0.2
    assert "'load 1 (ball of radius 106 mm)' clear of 'floor'" in found.labels


def test_loads_with_a_radius_keep_clear_of_the_links(tmp_path: Path) -> None:
    any_effort = '[excitation.limits]\neffort = "any"\n'
    load = "[[excitation.loads]]\nmass = 5.0\ncom = [0.0, 0.0, 0.2]\n"
    given = problem_of(tmp_path, f"{any_effort}{load}radius = 0.05\n")
    (clearance,) = given.constraints
    assert any("'load 1 (ball of radius 50 mm)' above" in label for label in clearance.labels)
    assert not any("without a radius" in note for note in given.notes)
    bare = problem_of(tmp_path, any_effort + load)
    assert not any("load" in label for c in bare.constraints for label in c.labels)
    (line,) = [note for note in bare.notes if "without a radius" in note]
    assert isinstance(line, Gap)


def test_the_tool_and_loads_keep_clear_of_the_cell(tmp_path: Path) -> None:
    cell = urdf(link("post", '<sphere radius="0.1"/>', xyz="2.0 0 0.5"), name="cell")
    written(tmp_path, cell, "cell.urdf")
    tables = '[excitation.limits]\neffort = "any"\n[excitation.workspace]\nradius = 0.05\n'
    tables += '[excitation.collision]\nworld = "cell.urdf"\nmargin = 0.02\n'
    tables += "[[excitation.loads]]\nmass = 5.0\n"
    problem = problem_of(tmp_path, tables)
    (found,) = [c for c in problem.constraints if c.name == WALLS_NAME]
    assert set(found.labels) == {
        "distance of 'ball of radius 50 mm at tool' and 'post' above 0.02 m",
        "distance of 'load 1 (ball of radius 106 mm)' and 'post' above 0.02 m",
    }


def test_the_floor_is_level_where_the_robot_leans(tmp_path: Path) -> None:
    written(tmp_path, BARE)
    head = '[robot]\nurdf = "arm.urdf"\ngravity = [9.81, 0.0, 0.0]\n'
    loaded = load_robot(written(tmp_path, head + ANY + "floor = -2.0\n", "leaning.toml"))
    np.testing.assert_allclose(up_of(loaded.robot), [-1.0, 0.0, 0.0])
    (found,) = [
        c
        for c in build(loaded, model_with_open_friction(loaded)).constraints
        if c.name == WALLS_NAME
    ]
    floor = next(s for s in found.scene.shapes if s.name == "floor")
    np.testing.assert_allclose(floor.rotation[:, 2], [-1.0, 0.0, 0.0])
    np.testing.assert_allclose(floor.position, [2.0, 0.0, 0.0])


def test_links_to_go_without_are_named_as_requested(tmp_path: Path) -> None:
    """Only where the walls' own table says so: that of clearance does not reach them."""
    tables = '[excitation.limits]\neffort = "any"\n[excitation.collision]\nwithout = ["stick"]\n'
    walls = f"{tables}[excitation.workspace]\nfloor = 0.0\n"
    every = problem_of(tmp_path, walls)
    (room,) = [c for c in every.constraints if c.name == WALLS_NAME]
    assert any("'stick' clear of 'floor'" in label for label in room.labels)
    assert room.scope.startswith("all links, tool")
    less = problem_of(tmp_path, f'{walls}without = ["stick"]\n')
    (room,) = [c for c in less.constraints if c.name == WALLS_NAME]
    assert not any("'stick'" in label for label in room.labels)
    assert room.scope.startswith("all links but stick, tool")
    assert any(
        isinstance(note, Declined) and "workspace limits ignore the links" in note
        for note in less.notes
    )
    assert not any("workspace limits ignore the links" in note for note in every.notes)


@pytest.mark.parametrize(
    ("tables", "where", "wrong"),
    [
        ("planes = [{normal = [0, 0, 0], above = 1.0}]", "planes", "no direction"),
        ("keep_out = [{x = [0, 1], y = [1, 0], z = [0, 1]}]", "keep_out", "box 1 is empty"),
        ("keep_out = [{x = [0, 1], y = [0, 1]}]", "keep_out", "is open"),
        ('frame = "tol"\nfloor = 0.0', "frame", "no frame 'tol'"),
        ('floor = 0.0\nwithout = ["sick"]', "", "no link 'sick'"),
    ],
)
def test_walls_that_make_no_sense(tmp_path: Path, tables: str, where: str, wrong: str) -> None:
    with pytest.raises(ModelError, match=wrong) as caught:
        problem_of(tmp_path, f"{ANY}{tables}\n")
    assert f"[excitation.workspace] {where}".rstrip() in caught.value.where


def test_closed_chains_are_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    loaded = replace(arm(tmp_path, ANY + "floor = 0.0\n"), robot=five_bar())
    from steelyard.excite.collision.workspace_from_tables import workspace_of

    with pytest.raises(ModelError, match="closed chains") as caught:
        workspace_of(loaded, ())
    assert "only_tool" in caught.value.fix


def test_the_elbow_of_a_ur10_stays_above_its_table(tmp_path: Path) -> None:
    """A tool box alone lets the elbow through the table; the floor does not."""
    loaded = ur10()
    path = loaded.sources[-1].path
    head = f"[robot]\nurdf = '{path}'\n" + ANY + "box = {z = [0.05, 1.5]}\n"
    box = "keep_out = [{x = [0.4, 0.8], y = [-0.3, 0.3], z = [0.0, 0.6]}]\nfloor = 0.0\n"
    loaded = load_robot(written(tmp_path, head + box, "ur10.toml"))
    problem = build(loaded, model_with_open_friction(loaded))
    motion = waves(loaded.robot, 0, 0.4)
    certificate = certify(loaded.robot, motion, problem.limits, problem.constraints)
    assert any("'forearm_link' clear of 'floor'" in line for line in certificate.failures)


@pytest.mark.slow
def test_the_demo_arm_stays_above_its_table(tmp_path: Path) -> None:
    loaded = write_demo_arm(tmp_path)
    problem = build(loaded, model_with_open_friction(loaded))
    (found,) = [c for c in problem.constraints if c.name == WALLS_NAME]
    assert {pair.second for pair in found.pairs} == {"floor"}
    assert {"upper_arm", "forearm", "wrist", "hand", "flange"} <= {p.first for p in found.pairs}
    below = 0
    for seed in range(3):
        free = random_fourier(loaded.robot, seed=seed, period=10.0)
        kept = _above_table(loaded, seed, 10.0)
        least = [_lowest(found, motion) for motion in (free, kept)]
        assert least[1] > 0.0
        below += least[0] < 0.0
    assert below > 0, "no motion needed the table"


def _lowest(found: Clearance, motion: ExactTrajectory) -> float:
    """Least height of all that moves above its floor, by coal [m]."""
    q = motion.derivative(np.linspace(0.0, motion.duration, 500), 0)
    ways = [way for pair in found.pairs for way in pair.shapes]
    return min(distances(found.robot, found.scene.shapes, way, q).min() for way in ways)


@pytest.mark.slow
def test_a_motion_that_is_proven_keeps_every_link_off_its_walls(tmp_path: Path) -> None:
    tables = ANY + WALLS + "radius = 0.03\n[excitation.motion]\nperiod = 4.0\nharmonics = 2\n"
    trajectory = some_motion(tmp_path, tables).trajectory
    found = room(tmp_path, WALLS + "radius = 0.03\n")
    q = trajectory.derivative(np.linspace(0.0, trajectory.duration, 4000), 0)
    for pair in found.pairs:
        for way in pair.shapes:
            assert distances(found.robot, found.scene.shapes, way, q).min() > 0.0


def test_a_certificate_keeps_what_it_does_not_cover(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, f"{ANY}floor = 0.0\n")
    motion = waves(problem.robot, 1, 0.05)
    notes = ("assumed", Gap("a gap"), Declined("as specified"))
    made = certify(problem.robot, motion, problem.limits, problem.constraints, notes=notes)
    assert (made.gaps, made.declined) == (("a gap",), ("as specified",))
    values = made.to_dict()
    assert values["notes"] == ["assumed", "a gap", "as specified"]
    assert (values["not_covered"], values["not_covered_as_asked"]) == (["a gap"], ["as specified"])
    assert "not covered are the approach to the start posture" in values["covers"]
    (walls,) = values["constraints"]
    assert walls["scope"].startswith("all links, tool and loads")

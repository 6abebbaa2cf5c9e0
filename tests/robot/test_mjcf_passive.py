import pickle
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.laws_without_friction import Spring
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.init import draft_robot_file as init_proposal
from steelyard.robot.init.draft_robot_file import assigned, drafted, notes_beside
from steelyard.robot.mechanism import Listed

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option{option}>{flag}</option>
  <worldbody>
    <body name="one"{one}><joint name="a" axis="0 1 0"{a}/><geom size=".1" pos=".2 0 0"/>
      <body name="two" pos=".4 0 0"{two}><joint name="b" axis="0 1 0"{b}/>
        <geom size=".1" pos=".2 0 0"/>
        <body name="three" pos=".4 0 0"><joint name="c" type="slide" axis="1 0 0"{c}/>
          <geom size=".1"/></body>
      </body>
    </body>
  </worldbody>
  {more}
</mujoco>
"""
PARTS = ("option", "flag", "one", "two", "a", "b", "c", "more")
COUPLED = '<equality><joint joint1="b" joint2="a" polycoef=".1 -2 0 0 0"/></equality>'


def written(folder: Path, **parts: str) -> Path:
    path = folder / "arm.xml"
    path.write_text(ARM.format(**(dict.fromkeys(PARTS, "") | parts)))
    return path


def with_tables(path: Path, tables: str) -> LoadedRobot:
    toml = path.with_name("made.toml")
    toml.write_text(f'[robot]\nmjcf = "{path.name}"\n{tables}')
    return load_robot(toml)


def proposed(path: Path) -> LoadedRobot:
    """The robot file that `init` writes."""
    target = path.with_name("proposed.toml")
    proposal = init_proposal.proposed(path)
    target.write_text(drafted(proposal, assigned(proposal, None, None), target).text)
    return load_robot(target)


SPRUNG = {
    "one": {"a": ' stiffness="3" springref=".2"'},
    "two, one of them sliding": {"a": ' stiffness="3"', "c": ' stiffness="40" springref="-.3"'},
    "a reference of its own": {"a": ' stiffness="3" springref=".2" ref=".5"'},
    "a follower's": {"b": ' stiffness="7" springref="-.4"', "more": COUPLED},
    "a follower's and its master's": {
        "a": ' stiffness="3" springref=".2"',
        "b": ' stiffness="7" springref="-.4"',
        "more": COUPLED,
    },
}


@pytest.mark.parametrize("case", SPRUNG)
def test_springs_that_init_proposes_pull_as_mujocos(tmp_path: Path, case: str) -> None:
    path = written(tmp_path, **SPRUNG[case])
    loaded = proposed(path)
    robot, springs = loaded.robot, loaded.springs
    (term,) = [term for term in model_with_open_friction(loaded).terms if isinstance(term, Spring)]
    stiffness = np.array([springs[name].stiffness for name in term.joints or ()])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for q in np.random.default_rng(1).uniform(-1.0, 1.0, (5, robot.n)):
        columns = term.columns(robot, JointState(list(q), [0.0] * robot.n, [0.0] * robot.n))
        torque = np.zeros(robot.n)
        for (joint, parameter), column in columns.items():
            torque[joint] += column * stiffness[parameter]
        slopes = np.zeros((model.nv, robot.n))
        for body in robot.bodies:
            at = model.joint(body.joint)
            data.qpos[at.qposadr[0]] = body.ratio * q[body.coordinate] + body.offset
            slopes[at.dofadr[0], body.coordinate] = body.ratio
        mujoco.mj_forward(model, data)
        assert torque == pytest.approx(-slopes.T @ data.qfrc_passive, abs=1e-9)


def test_springs_are_named_until_a_term_has_them(tmp_path: Path) -> None:
    path = written(tmp_path, a=' stiffness="3" springref=".2"', c=' stiffness="40 5"')
    (note,) = load_robot(path).notes
    assert note.startswith("springs along joints are in the model file; a term")
    assert note.endswith(
        ": a (3 Nm/rad, free at 0.2 rad), c (40 N/m and higher powers, free at 0 m)"
    )
    assert with_tables(path, '[model]\nterms = ["rigid_body", "viscous"]\n').notes == (note,)
    for spring in ('"spring"', '{law = "spring", joints = ["a"]}'):
        assert not with_tables(path, f'[model]\nterms = ["rigid_body", {spring}]\n').notes
    (locked,) = with_tables(path, "[robot.locked]\nc = 0.0\n").notes
    assert locked.endswith(": a (3 Nm/rad, free at 0.2 rad)")


def test_springs_that_are_switched_off_are_none(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        a=' stiffness="3"',
        flag='<flag spring="disable"/>',
        more='<tendon><fixed stiffness="4"><joint joint="a" coef="1"/></fixed></tendon>',
    )
    loaded = load_robot(path)
    assert not loaded.notes and not loaded.springs


def test_gravity_that_is_switched_off_stays_and_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, option=' gravity="0 1 -9"', flag='<flag gravity="disable"/>')
    loaded = load_robot(path)
    assert loaded.robot.gravity == pytest.approx([0.0, 1.0, -9.0])
    assert loaded.notes == (
        "the MJCF disables gravity; the robot has [0, 1, -9] m/s² anyway: state gravity "
        "under [robot], [0.0, 0.0, 0.0] for none",
    )
    for line in ("gravity = [0.0, 0.0, 0.0]", "mounting = {pitch = 90.0}"):
        assert not with_tables(path, line).notes


def test_a_world_without_gravity_is_followed_and_named(tmp_path: Path) -> None:
    path = written(tmp_path, option=' gravity="0 0 0"', one=' gravcomp="1"')
    loaded = load_robot(path)
    assert not loaded.robot.gravity.any()
    (note,) = loaded.notes
    assert note.startswith("the MJCF has no gravity, so the robot has none")


def test_bodies_relieved_of_gravity_are_named(tmp_path: Path) -> None:
    path = written(tmp_path, two=' gravcomp="1"')
    loaded = load_robot(path)
    (note,) = loaded.notes
    assert note.startswith("gravity compensation of bodies in the MJCF (gravcomp)")
    assert note.endswith(": a, b")
    compensated = written(tmp_path, two=' gravcomp="1"', a=' actuatorgravcomp="true"')
    assert load_robot(compensated).notes == (note.replace(": a, b", ": b"),)
    signals = (
        '[signals]\ntime = "t"\nposition = "q{}"\nposition_unit = ["rad", "rad", "m"]\n'
        '[signals.effort]\ncolumns = "f{}"\nkind = "gravity_compensated_torque"\n'
        'unit = ["Nm", "Nm", "N"]\n'
    )
    assert with_tables(path, signals).notes == (
        "efforts are gravity compensated: the model has none either",
    )


def test_tendons_and_fluids_are_named(tmp_path: Path) -> None:
    fixed = '<fixed name="{}" {}><joint joint="{}" coef="1"/><joint joint="{}" coef="-2"/></fixed>'
    path = written(
        tmp_path,
        option=' density="1000" wind="1 0 0"',
        more="<tendon>"
        + fixed.format("stiff", 'stiffness="4" damping="2"', "a", "b")
        + fixed.format("heavy", 'armature=".1"', "b", "c")
        + fixed.format("bare", "", "a", "c")
        + "</tendon>",
    )
    tendons, fluid = load_robot(path).notes
    assert tendons.endswith(
        "(along = {...}): 'stiff' on a, b (stiffness, damping), 'heavy' on b, c (armature)"
    )
    assert "unless a term represents them" in tendons
    assert fluid == (
        "forces of a fluid in the MJCF (density 1000 kg/m³, viscosity 0 Pa s) are not in the model"
    )
    assert with_tables(path, 'tip = "one"').notes[-1] == fluid


def test_what_a_new_robot_file_resolves_is_still_reported_once(tmp_path: Path) -> None:
    path = written(
        tmp_path, flag='<flag gravity="disable"/>', a=' stiffness="3"', two=' gravcomp="1"'
    )
    bare, made = load_robot(path), proposed(path)
    assert len(made.notes) < len(bare.notes) == 2
    assert notes_beside(bare, made) == bare.notes


def test_of_a_statement_with_a_list_the_robot_files_holds(tmp_path: Path) -> None:
    loaded = load_robot(written(tmp_path))
    bare, made = (
        replace(loaded, notes=(Listed("left out", names), f"to be known: {names}"))
        for names in ("a, b", "a")
    )
    assert notes_beside(bare, made) == ("left out: a", "to be known: a, b", "to be known: a")
    assert pickle.loads(pickle.dumps(made.notes[0])).statement == "left out"


def test_a_plain_arm_has_nothing_to_tell(tmp_path: Path) -> None:
    assert not load_robot(written(tmp_path)).notes

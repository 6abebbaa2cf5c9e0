"""Without any masses, friction that drives a joint tells a sign that is turned."""

import re

import numpy as np
import pytest

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.decision.hypothesis_checks import EFFORT_SIGN
from steelyard.check.finding import Severity
from steelyard.check.hypotheses.signs_and_delay_by_friction import friction_of_rows, friction_signs

TAU = "tau{}_Nm"


@pytest.fixture
def massless(arm: Arm) -> Arm:
    """The arm with a URDF that has no inertials."""
    urdf = arm.path.parent / "demo_arm.urdf"
    urdf.write_text(re.sub(r"<inertial>.*?</inertial>", "", urdf.read_text(), flags=re.DOTALL))
    return arm


def with_signs(arm: Arm, signs: Array) -> Array:
    table = arm.table.copy()
    table[:, arm.at(TAU)] *= signs
    return table


def test_friction_that_brakes_raises_no_alarm(massless: Arm) -> None:
    case = massless.case(massless.table, known=False)
    drives = friction_of_rows(case, case.logs[0])
    assert sum(d.brakes for d in drives.values()) >= 2 and not any(
        d.drives for d in drives.values()
    )
    assert [f.severity for f in EFFORT_SIGN(case)] == [Severity.OK]


@pytest.mark.parametrize("joint", [0, 1])
def test_one_effort_that_is_turned_is_found(massless: Arm, joint: int) -> None:
    signs = np.where(np.arange(3) == joint, -1.0, 1.0)
    (found,) = EFFORT_SIGN(massless.case(with_signs(massless, signs), known=False))
    assert found.severity == Severity.DOUBTFUL
    assert found.joints == (massless.robot.joint_names[joint],)
    assert "has the wrong sign, or the position has" in found.says
    assert found.fix is not None and not found.fix.edits


def test_all_efforts_that_are_turned_are_one_finding(massless: Arm) -> None:
    (found,) = EFFORT_SIGN(massless.case(with_signs(massless, -np.ones(3)), known=False))
    assert found.severity == Severity.WRONG and found.says.startswith("all efforts")
    assert found.fix is not None and found.fix.edits[0].value == [-1.0] * 3


def test_a_joint_with_hardly_any_friction_raises_no_alarm(massless: Arm) -> None:
    names, values = massless.truth.values.names, massless.truth.values.values.copy()
    for k, name in enumerate(names):
        if name.split(".")[0] in ("coulomb", "viscous"):
            values[k] *= 1e-3
    free = type(massless.truth.values)(names, massless.truth.values.units, values)
    rng = np.random.default_rng(1)
    torque = massless.truth.model.at(free).torque(massless.motion)
    table = massless.table.copy()
    noise = 0.03 * torque.std(axis=0) * rng.standard_normal(torque.shape)
    for signs in (np.ones(3), np.array([1.0, -1.0, 1.0])):
        table[:, massless.at(TAU)] = (torque + noise) * signs
        assert friction_signs(massless.case(table, known=False)) == ()


def test_a_negative_gain_that_is_declared_is_counted_in(massless: Arm) -> None:
    signs = np.array([1.0, -1.0, -1.0])
    gain = f'unit = "Nm"\ngain = {signs.tolist()}'
    text = massless.text.replace('unit = "Nm"', gain)
    turned = massless.case(with_signs(massless, signs), text, known=False)
    assert friction_signs(turned) == ()
    (found,) = friction_signs(massless.case(massless.table, text, known=False))
    assert set(found.joints) <= {massless.robot.joint_names[k] for k in (1, 2)}

"""Faults that only a model can tell: the verdict, and a correct that is exact."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from steelyard.check.all_checks import Diagnosis, edits_that_serve_all_logs, examine
from steelyard.check.cases_and_checks import effort_predictor
from steelyard.check.decision.gears_and_friction_of_logs import friction_drift_check
from steelyard.check.decision.hypothesis_checks import MOUNTING, PAYLOAD, UNKNOWN_BODIES
from steelyard.check.decision.ranked_readings import COMPARING_PHASE
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Edit, Finding, Fix, Severity
from steelyard.check.fitted.implausible_estimates_and_gear_side import identifiability_check
from steelyard.check.hypotheses.nuisance_fit_and_score import fit_nuisances, shared_fit
from steelyard.estimate.estimate import KnownScales
from steelyard.robot.file.toml_edits import edited
from steelyard.robot.inertia_and_placement import Inertia

Q, DQ, TAU = "q{}_rad", "dq{}_rad_s", "tau{}_Nm"
GAINS = np.array([9.0, 12.0, 7.5])


def wrong(found: Diagnosis) -> list[str]:
    """Names of the checks that are sure."""
    return [f.check for f in found.findings if f.severity == Severity.WRONG]


def edits(found: Diagnosis) -> dict[str, Any]:
    """Keys of the robot file and what they should be."""
    return {".".join(e.path): e.value for e in found.edits}


def names(pattern: str, order: Sequence[int]) -> list[str]:
    """Columns in an order of joints that counts from 0."""
    return [pattern.format(k + 1) for k in order]


def test_a_clean_log_is_clean(arm):
    found = arm.examined(arm.table)
    assert found.severity == Severity.OK
    assert len(found.findings) == 9
    assert found.edits == ()
    assert all("misfit" in f.figure and f.hypotheses for f in found.findings)


@pytest.mark.parametrize("order", [[1, 0, 2], [1, 2, 0], [2, 1, 0]])
def test_joints_in_another_order(arm, order):
    table = arm.table.copy()
    for pattern in (Q, DQ, TAU):
        table[:, arm.at(pattern)] = arm.table[:, np.array(arm.at(pattern))[order]]
    found = arm.examined(table)
    back = np.argsort(order)
    assert wrong(found) == ["joint order"]
    assert edits(found) == {
        "signals.position": names(Q, back),
        "signals.velocity": names(DQ, back),
        "signals.effort.columns": names(TAU, back),
    }


def test_positions_alone_in_another_order_leave_velocities(arm):
    table = arm.table.copy()
    table[:, arm.at(Q)] = arm.table[:, np.array(arm.at(Q))[[0, 2, 1]]]
    found = arm.examined(table)
    assert wrong(found) == ["joint order"]
    assert edits(found) == {"signals.position": names(Q, [0, 2, 1])}


@pytest.mark.slow
@pytest.mark.parametrize("swap", [True, False])
def test_velocities_are_not_blamed_for_positions(arm, swap):
    table = arm.table.copy()
    if swap:
        table[:, arm.at(Q)] = arm.table[:, np.array(arm.at(Q))[[0, 2, 1]]]
    else:
        table[:, arm.at(Q)[1]] *= -1.0
    found = examine(arm.case(table), quick=True)
    assert wrong(found) == ["joint order" if swap else "position sign"]
    assert len(found.edits) == 1


@pytest.mark.slow
def test_velocities_alone_are_blamed_for_themselves(arm):
    table = arm.table.copy()
    table[:, arm.at(DQ)] = arm.table[:, np.array(arm.at(DQ))[[0, 2, 1]]]
    found = examine(arm.case(table), quick=True)
    assert wrong(found) == ["velocity"]


def test_efforts_in_another_order(arm):
    order = [2, 0, 1]
    table = arm.table.copy()
    table[:, arm.at(TAU)] = arm.table[:, np.array(arm.at(TAU))[order]]
    found = arm.examined(table)
    assert wrong(found) == ["joint order"]
    assert edits(found) == {"signals.effort.columns": names(TAU, np.argsort(order))}


@pytest.mark.parametrize("joints", [[1], [0, 2], [1, 2]])
def test_positions_that_count_the_other_way(arm, joints):
    table = arm.table.copy()
    signs = [-1 if j in joints else 1 for j in range(3)]
    table[:, arm.at(Q)] *= signs
    table[:, arm.at(DQ)] *= signs
    found = arm.examined(table)
    assert wrong(found) == ["position sign"]
    assert edits(found) == {"signals.position_sign": signs, "signals.velocity_sign": signs}


def test_a_declared_sign_is_turned_back(arm):
    text = edited(arm.text, [Edit(("signals", "position_sign"), [1, -1, 1])])
    found = arm.examined(arm.table, text)
    assert edits(found) == {"signals.position_sign": [1] * 3}


@pytest.mark.parametrize("joints", [[2], [0, 1, 2]])
def test_efforts_of_the_other_sign(arm, joints):
    table = arm.table.copy()
    signs = [-1.0 if j in joints else 1.0 for j in range(3)]
    table[:, arm.at(TAU)] *= signs
    found = arm.examined(table)
    assert wrong(found) == ["effort sign"]
    assert edits(found) == {"signals.effort.gain": signs}


def in_amperes(arm) -> str:
    """The robot file of an arm that logs currents."""
    keys = {"kind": "motor_current", "unit": "A", "gain": GAINS.tolist()}
    return edited(arm.text, [Edit(("signals", "effort", k), v) for k, v in keys.items()])


def test_milliamperes(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)] *= 1e3 / GAINS
    found = arm.examined(table, in_amperes(arm))
    assert wrong(found) == ["effort unit"]
    assert edits(found) == {"signals.effort.unit": "mA"}


def test_torques_declared_as_currents(arm):
    found = arm.examined(arm.table, in_amperes(arm))
    assert wrong(found) == ["effort kind"]
    assert edits(found) == {
        "signals.effort.kind": "joint_torque",
        "signals.effort.unit": "Nm",
        "signals.effort.gain": None,
    }


def test_currents_declared_as_torques(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)] /= GAINS
    found = arm.examined(table)
    assert wrong(found) == ["effort kind"]
    proposed = edits(found)
    assert proposed.pop("signals.effort.kind") == "motor_current"
    assert proposed.pop("signals.effort.unit") == "A"
    np.testing.assert_allclose(proposed.pop("signals.effort.gain"), GAINS, rtol=0.05)
    assert not proposed


def without_gravity(arm) -> np.ndarray:
    """The log less the torque that holds the true arm."""
    from steelyard.model.laws.laws_without_friction import RigidBody
    from steelyard.model.model import Model

    robot = arm.robot
    torques = []
    for gravity in (robot.gravity, np.zeros(3)):
        model = Model(robot.changed(gravity=gravity), (RigidBody(),))
        values = arm.truth.values.as_dict()
        known = type(arm.truth.values)(model.names, model.units, [values[x] for x in model.names])
        torques.append(model.at(known).torque(arm.motion))
    table = arm.table.copy()
    table[:, arm.at(TAU)] -= torques[0] - torques[1]
    return table


def test_efforts_without_gravity(arm):
    found = arm.examined(without_gravity(arm))
    assert wrong(found) == ["effort kind"]
    assert edits(found) == {"signals.effort.kind": "gravity_compensated_torque"}


@pytest.mark.parametrize("ratio", [1.4, 0.5])
def test_a_gain_that_is_off(arm, ratio):
    table = arm.table.copy()
    table[:, arm.at(TAU)[1]] *= ratio
    found = arm.examined(table)
    assert wrong(found) == ["gain"]
    wanted = [1.0, 1.0 / ratio, 1.0]
    np.testing.assert_allclose(edits(found)["signals.effort.gain"], wanted, rtol=0.03)


def test_efforts_that_are_late(arm):
    table = arm.table.copy()
    for k in arm.at(TAU):
        table[:, k] = np.interp(table[:, 0] - 0.02, table[:, 0], arm.table[:, k])
    found = arm.examined(table)
    assert wrong(found) == ["effort delay"]
    assert edits(found)["signals.effort.delay"] == pytest.approx(0.02, abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [[9.81, 0.0, 0.0], [0.0, 0.0, 9.81]])
def test_gravity_declared_elsewhere(arm, gravity):
    text = edited(arm.text, [Edit(("robot", "gravity"), gravity)])
    found = arm.examined(arm.table, text)
    assert wrong(found) == ["mounting"]
    assert edits(found) == {"robot.gravity": [0.0, 0.0, -9.81], "robot.mounting": None}


def with_payload(arm, mass: float) -> np.ndarray:
    """The log of the arm with something in its hand."""
    ten = Inertia.about_com(mass, [0.02, 0.0, 0.08], np.eye(3) * 0.005).ten
    known = effort_predictor(arm.reference, arm.robot)
    m = arm.motion
    columns = known.payload(m.q.T, m.dq.T, m.ddq.T, arm.robot.gravity)
    table = arm.table.copy()
    table[:, arm.at(TAU)] += np.einsum("k,knb->bn", ten, columns)
    return table


def test_a_payload_left_on(arm):
    found = arm.examined(with_payload(arm, 2.5))
    assert wrong(found) == ["payload"]
    assert not found.edits
    finding = next(f for f in found.findings if f.check == "payload")
    assert "about 2.5 kg" in finding.says and "±" not in finding.says
    assert finding.fix is not None and "--loaded" in finding.fix.says
    assert finding.picture is not None


@pytest.mark.slow
def test_two_faults_at_once(six):
    table = six.table.copy()
    order = [1, 0, 2, 3, 4, 5]
    table[:, six.at(TAU)] = -six.table[:, np.array(six.at(TAU))[order]]
    found = six.examined(table)
    assert sorted(wrong(found)) == ["effort sign", "joint order"]
    assert edits(found) == {
        "signals.effort.columns": names(TAU, order),
        "signals.effort.gain": [-1.0] * 6,
    }


def test_degrees_are_left_to_the_suspicion_of_positions(arm):
    table = arm.table.copy()
    table[:, arm.at(Q)] *= 180.0 / np.pi
    assert not wrong(arm.examined(table))


def test_a_resting_robot_tells_nothing(arm):
    table = np.repeat(arm.table[:1], 2000, axis=0)
    table[:, 0] = 0.005 * np.arange(2000)
    assert arm.examined(table).findings == ()


def test_a_rough_nominal_model_raises_no_alarm(arm):
    case = arm.case(arm.table, known=False)
    decision = judge_log(case, case.logs[0])
    assert decision is not None and not decision.winners


def test_without_masses_nothing_is_reported(arm):
    urdf = arm.path.parent / "demo_arm.urdf"
    urdf.write_text(re.sub(r"<inertial>.*?</inertial>", "", urdf.read_text(), flags=re.DOTALL))
    found = arm.examined(arm.table, known=False)
    assert found.severity == Severity.OK
    assert {f.says for f in found.findings} == {UNKNOWN_BODIES}
    assert len(found.findings) == 9


@pytest.mark.slow
def test_friction_of_another_day(arm):
    tables = []
    for factor in (1.0, 3.5):
        values = arm.truth.values.as_dict()
        changed = {
            name: factor * x if name.startswith(("coulomb", "viscous")) else x
            for name, x in values.items()
        }
        known = type(arm.truth.values)(
            arm.truth.values.names, arm.truth.values.units, list(changed.values())
        )
        table = arm.table.copy()
        table[:, arm.at(TAU)] = arm.truth.model.at(known).torque(arm.motion)
        tables.append(arm.case(table).logs[0])
    case = arm.case(arm.table)
    alike = type(case)(case.loaded, (case.logs[0], tables[0]), case.reference)
    apart = type(case)(case.loaded, (case.logs[0], tables[1]), None)
    assert friction_drift_check(case) == ()
    assert [f.severity for f in friction_drift_check(alike)] == [Severity.OK]
    assert [f.severity for f in friction_drift_check(apart)] == [Severity.DOUBTFUL]


def test_what_a_log_shows(arm):
    found = identifiability_check(arm.case(arm.table))
    assert [f.severity for f in found] == [Severity.OK]
    table = arm.table.copy()
    table[:, arm.at(Q)[0]] = table[0, arm.at(Q)[0]]
    table[:, arm.at(DQ)[0]] = 0.0
    (found,) = identifiability_check(arm.case(table))
    assert found.severity == Severity.DOUBTFUL
    assert "shoulder_turn" in found.fix.says


def test_what_a_log_shows_is_stated_of_the_friction_that_was_assumed(arm):
    text = arm.text.replace('"coulomb", "viscous", "offset"]', '"offset"]\nfriction = "auto"')
    (found,) = identifiability_check(arm.case(arm.table, text, known=False))
    assert "base parameters (of the model with Coulomb and viscous friction) identifiable" in (
        found.says
    )
    (found,) = identifiability_check(arm.case(arm.table, text))
    assert "base parameters identifiable" in found.says


def test_bounded_friction_against_scipy():
    rng = np.random.default_rng(0)
    y, e = rng.normal(size=(5, 300)), rng.normal(size=300)
    lower, upper = np.array([0.0, -0.01, -np.inf, 0.0]), np.array([0.02, 0.05, np.inf, np.inf])
    squares, theta = fit_nuisances(
        y @ y.T, y @ e, np.array(e @ e), np.array(1.7), lower, upper, 200
    )
    wanted = lsq_linear(y[:4].T, 1.7 * e - y[4], (lower, upper), tol=1e-14)
    np.testing.assert_allclose(theta, wanted.x, atol=1e-6)
    assert float(squares) == pytest.approx(2.0 * wanted.cost, rel=1e-9)


def test_shared_numbers_are_least_squares():
    rng = np.random.default_rng(1)
    columns, y = rng.normal(size=(3, 2, 200)), rng.normal(size=(2, 4, 200))
    y[:, 2] = 1.0
    truth = np.array([1.0, -2.0, 0.5])
    residual = np.einsum("k,knb->nb", truth, columns) + 0.3 * y[:, 0] - 0.1 * y[:, 2]
    free = np.full((2, 4), -np.inf), np.full((2, 4), np.inf)
    values, _ = shared_fit(residual, columns, y, free, np.full(2, 0.1), 1.0, np.full(3, 100.0))
    np.testing.assert_allclose(values, truth, atol=1e-5)
    noisy = residual + 0.1 * rng.normal(size=residual.shape)
    values, covariance = shared_fit(
        noisy, columns, y, free, np.full(2, 1e-3), 1.0, np.full(3, 100.0)
    )
    assert np.all(np.abs(values - truth) < 4.0 * np.sqrt(np.diag(covariance)))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), 0.1 / 20.0, rtol=0.3)


def at_motors(arm, ratios) -> tuple[np.ndarray, str]:
    """The log as motors of these ratios would give it, and the robot file that says so."""
    table = arm.table.copy()
    for pattern in (Q, DQ):
        table[:, arm.at(pattern)] *= ratios
    table[:, arm.at(TAU)] /= ratios
    changes = {
        ("signals", "coordinates"): "motor",
        ("signals", "effort", "side"): "motor",
        ("signals", "effort", "kind"): "motor_torque",
        ("robot", "transmission", "ratios"): ratios.tolist(),
    }
    return table, edited(arm.text, [Edit(path, value) for path, value in changes.items()])


@pytest.mark.slow
def test_a_gear_ratio_that_is_off(arm):
    ratios = np.array([50.0, 80.0, -30.0])
    table, text = at_motors(arm, ratios)
    assert arm.examined(table, text).severity == Severity.OK
    off = ratios.copy()
    off[1] = 50.0
    found = arm.examined(table, edited(text, [Edit(("robot", "transmission", "ratios"), off)]))
    assert wrong(found) == ["gain"]
    assert edits(found) == {"robot.transmission.ratios": ratios.tolist()}


@pytest.mark.slow
def test_the_gain_behind_a_motor_is_the_motors(arm):
    table, text = at_motors(arm, np.array([50.0, 80.0, -30.0]))
    table[:, arm.at(TAU)[2]] *= -1.0
    found = arm.examined(table, text)
    assert wrong(found) == ["effort sign"]
    assert edits(found) == {"signals.effort.gain": [1.0, 1.0, -1.0]}


@pytest.mark.slow
def test_a_sign_of_one_joint_is_reported_without_a_reference(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)[1]] *= -1.0
    found = arm.examined(table, known=False)
    assert wrong(found) == ["effort sign"]
    assert edits(found) == {"signals.effort.gain": [1.0, -1.0, 1.0]}


def test_one_factor_on_all_efforts_is_one_factor(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)] *= 2.0
    found = arm.examined(table)
    assert wrong(found) == ["gain"]
    (gain,) = edits(found).values()
    assert np.allclose(gain, 0.5, rtol=0.05) and len(set(gain)) == 1


def test_one_joint_a_thousand_times_too_large(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)[1]] *= 1000.0
    found = arm.examined(table)
    assert wrong(found) == ["gain"]
    gain = edits(found)["signals.effort.gain"]
    assert gain[1] == pytest.approx(1e-3, rel=0.1) and set(np.delete(gain, 1)) == {1.0}


@pytest.mark.slow
def test_what_nothing_explains_is_doubtful_once(arm):
    table = arm.table.copy()
    t = table[:, arm.columns.index("time_s")]
    table[:, arm.at(TAU)] = 20.0 * np.sin(np.outer(t, np.arange(1.1, 2.6, 0.5)))
    found = arm.examined(table, known=False)
    (kind,) = (f for f in found.findings if f.severity)
    assert kind.check == "effort kind" and kind.fix is not None
    assert "the model file is of another robot" in kind.fix.says
    assert found.severity == Severity.DOUBTFUL
    assert not any(f.answered for f in found.findings)


def finding(log: str, severity: Severity, value: Any = None, answered: bool = True) -> Finding:
    fix = None if value is None else Fix("say so", (Edit(("signals", "effort", "gain"), value),))
    return Finding("gain", log, severity, "", "", fix=fix, answered=answered)


def test_one_robot_file_must_serve_all_logs():
    bad, good = finding("a", Severity.WRONG, [1.0, 2.0]), finding("b", Severity.OK)
    apart = edits_that_serve_all_logs([bad, good])[0].fix
    assert apart is not None and not apart.edits and "of its own" in apart.says
    open_one = finding("b", Severity.OK, answered=False)
    assert not Diagnosis(edits_that_serve_all_logs([bad, open_one])).edits
    others = [finding("b", Severity.WRONG, [1.1, 2.0]), finding("c", Severity.WRONG, [1.05, 1.9])]
    merged = {
        tuple(f.fix.edits[0].value) for f in edits_that_serve_all_logs([bad, *others]) if f.fix
    }
    assert merged == {(1.05, 2.0)}
    signs = [finding("a", Severity.WRONG, [1, -1]), finding("b", Severity.WRONG, [-1, 1])]
    assert not any(f.fix.edits for f in edits_that_serve_all_logs(signs) if f.fix)


def test_the_work_that_questions_share_is_named(arm):
    heard = []
    case = replace(arm.case(arm.table), progress=lambda event: heard.append(event) or True)
    examine(case, checks=[MOUNTING, PAYLOAD])
    events = [(e.phase, e.done, e.total, e.note) for e in heard if e.phase == COMPARING_PHASE]
    assert events == [(COMPARING_PHASE, 0, 1, "log"), (COMPARING_PHASE, 1, 1, "log")]


@pytest.mark.slow
def test_scales_that_the_reference_found_of_the_sensors_are_no_gains_that_are_wrong(arm):
    scales = np.array([1.0, 1.0, 1.25])
    table = arm.table.copy()
    table[:, arm.at(TAU)] *= scales
    assert wrong(arm.examined(table)) == ["gain"]
    signals = replace(arm.reference.signals, gains=arm.reference.signals.gains / scales)
    known = replace(
        arm.reference,
        effort_scales=KnownScales(arm.reference.joints, scales, 1e-4 * np.eye(3)),
        signals=signals,
    )
    assert not wrong(replace(arm, reference=known).examined(table))
    for gain in ('"identify"', str(signals.gains.tolist())):
        text = arm.text.replace('unit = "Nm"', f'unit = "Nm"\ngain = {gain}')
        assert not wrong(replace(arm, reference=known).examined(table, text))
    table[:, arm.at(TAU)[1]] *= 2.0
    found = replace(arm, reference=known).examined(table)
    assert wrong(found) == ["gain"]
    np.testing.assert_allclose(edits(found)["signals.effort.gain"][1], 0.5, rtol=0.02)


def test_efforts_far_too_early_are_found_against_a_reference(arm):
    table, t = arm.table.copy(), arm.table[:, 0]
    for column in arm.at(TAU):
        table[:, column] = np.interp(t + 0.18, t, arm.table[:, column])
    found = arm.examined(table)
    assert wrong(found) == ["effort delay"]
    assert edits(found)["signals.effort.delay"] == pytest.approx(-0.18, abs=0.003)

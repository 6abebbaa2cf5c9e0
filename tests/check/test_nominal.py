"""What may be concluded where nothing but a nominal model is known, which may be far off."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from check.conftest import MODEL_BASED
from check.test_model_based import (
    DQ,
    GAINS,
    TAU,
    Q,
    edits,
    in_amperes,
    names,
    with_payload,
    without_gravity,
    wrong,
)
from steelyard.check.all_checks import examine
from steelyard.check.cases_and_checks import Case, CheckedLog, effort_predictor
from steelyard.check.decision import verdict_of_log
from steelyard.check.decision.drive_gains_and_what_init_learns import _listed_sources
from steelyard.check.decision.hypothesis_checks import EFFORT_DELAY, EFFORT_SIGN
from steelyard.check.decision.ranked_readings import ranking
from steelyard.check.decision.undecided_questions import misfit_hides
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Edit, Severity
from steelyard.check.findings_text_and_page import check_headline
from steelyard.check.hypotheses import evidence_with_unknown_bodies
from steelyard.check.hypotheses.evidence_with_unknown_bodies import EvidenceOfLog
from steelyard.check.hypotheses.gravity_payload_and_delay import _DirectionResidual
from steelyard.check.hypotheses.hypotheses_and_their_scores import LIKELY, SURE
from steelyard.model.model import Model
from steelyard.robot.file.toml_edits import edited
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording


def nominal_times(arm, factor: float) -> None:
    """Make all links of the URDF heavier."""
    urdf = arm.path.parent / "demo_arm.urdf"
    text = urdf.read_text()
    for number in ("mass value", "ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
        text = re.sub(
            rf'{number}="([^"]+)"',
            lambda found, number=number: f'{number}="{factor * float(found[1])!r}"',
            text,
        )
    urdf.write_text(text)


@pytest.mark.parametrize("known", [True, False])
def test_findings_hold_what_their_explanations_were_compared_with(arm, known):
    ranked = [f for f in arm.examined(arm.table, known=known).findings if f.hypotheses]
    assert ranked and all(f.nominal is not known for f in ranked)
    for finding in ranked:
        assert [h.says for h in finding.hypotheses if h.declared] == ["as declared"]


def test_slopes_of_the_direction_of_gravity(arm):
    case = arm.case(arm.table, known=False)
    ranked = ranking(case, case.logs[0])
    left = _DirectionResidual(ranked.declared.reading)
    at = np.array([0.3, -0.8, 0.4])
    numeric = [(left(at + h)[0] - left(at - h)[0]) / 2e-5 for h in 1e-5 * np.eye(3)]
    np.testing.assert_allclose(left(at)[1], numeric, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.3, 3.5])
def test_a_clean_log_is_not_refused_for_wrong_masses(arm, factor):
    nominal_times(arm, factor)
    case = arm.case(arm.table, known=False)
    found = examine(case, checks=MODEL_BASED)
    assert found.severity <= Severity.DOUBTFUL and not found.edits
    for doubtful in (f for f in found.findings if f.severity):
        assert "links are" in doubtful.says and "efforts are off" in doubtful.says
    ranked = ranking(case, case.logs[0])
    found = ranked.search.best.evidence
    assert found.scale * factor == pytest.approx(1.0, rel=0.3)
    assert found.percent < 4.5 < ranked.declared.percent


def test_currents_as_torques_are_refused_without_numbers(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)] /= GAINS
    found = arm.examined(table, known=False)
    assert wrong(found) == ["effort kind"] and not found.edits
    fix = next(f.fix for f in found.findings if f.severity)
    assert fix is not None and 'gain = "identify"' in fix.says and "--loaded" in fix.says


@pytest.mark.slow
def test_joints_off_by_their_own_large_factors_are_never_ok(six):
    table = six.table.copy()
    table[:, six.at(TAU)] /= np.array([900.0, 1200.0, 800.0, 200.0, 200.0, 150.0])
    found = six.examined(table, known=False)
    assert wrong(found) == ["effort kind"] and not found.edits
    assert {"effort unit", "gain", "payload"} <= set(found.open_checks)


@pytest.mark.slow
def test_links_of_another_size_leave_the_kind_of_efforts_open(six):
    table = six.table.copy()
    table[:, six.at(TAU)] *= 1.8
    found = six.examined(table, known=False)
    kind = next(f for f in found.findings if f.check == "effort kind")
    assert kind.severity or (not kind.answered and "times as heavy" in kind.says)


def test_a_dead_effort_is_not_that_of_another_joint(six):
    table = six.table.copy()
    table[:, six.at(TAU)[0]] = 0.0
    case = six.case(table, known=False)
    likelihood = ranking(case, case.logs[0]).likelihood
    assert likelihood.excerpt.dead == (0,)
    moved = likelihood.declared.changed(effort=(2, 1, 0, 3, 4, 5))
    assert not moved.keeps_evidence and likelihood.declared.keeps_evidence
    assert "joint order" not in wrong(six.examined(table, known=False))


@pytest.mark.parametrize("limits", [{"ROOM": 1}, {"MOST_WORK": 1.0, "LEAST_SCREENED": 12}])
def test_what_a_robot_with_many_joints_has_no_room_for_changes_no_finding(arm, monkeypatch, limits):
    table = arm.table.copy()
    table[:, arm.at(TAU)[1]] *= -1.0
    usual = arm.examined(table, known=False)
    for name, value in limits.items():
        monkeypatch.setattr(evidence_with_unknown_bodies, name, value)
    less = arm.examined(table, known=False)
    assert wrong(less) == wrong(usual) == ["effort sign"] and less.edits == usual.edits
    if "ROOM" in limits:
        assert [f.says for f in less.findings] == [f.says for f in usual.findings]


def logs_of(arm, **tables) -> Case:
    """Several logs of one robot file, with nothing known but the nominal model."""
    case = arm.case(arm.table, known=False)
    logs = tuple(
        CheckedLog(
            Recording(LogInMemory(Path(name), arm.columns, table), case.loaded.signals),
            Processing(),
            name,
        )
        for name, table in tables.items()
    )
    return replace(case, logs=logs)


def test_logs_that_exclude_each_others_corrections_are_doubtful(arm):
    turned, exchanged = arm.table.copy(), arm.table.copy()
    tau = arm.at(TAU)
    turned[:, tau[1]] *= -1.0
    exchanged[:, tau[:2]] = exchanged[:, tau[1::-1]]

    def severities(**tables) -> dict[tuple[str, str], Severity]:
        found = examine(logs_of(arm, **tables), checks=MODEL_BASED).findings
        return {(f.check, f.log): f.severity for f in found if f.severity}

    sign, order = "effort sign", "joint order"
    assert severities(a=turned, b=turned.copy()) == dict.fromkeys(
        [(sign, "a"), (sign, "b")], Severity.WRONG
    )
    # a log that is as declared may have been recorded otherwise
    assert severities(a=turned, b=arm.table) == {(sign, "a"): Severity.WRONG}
    assert severities(a=turned, b=exchanged) == {
        (sign, "a"): Severity.DOUBTFUL,
        (order, "b"): Severity.DOUBTFUL,
    }
    says = [
        f.says for f in examine(logs_of(arm, a=turned, b=exchanged), checks=MODEL_BASED).findings
    ]
    assert any("not by b, which is not as declared either" in one for one in says)


@pytest.mark.slow
def test_a_log_that_alone_decides_nothing_supports_what_others_show(arm):
    late = arm.table.copy()
    for tau in arm.at(TAU):
        late[:, tau] = np.interp(late[:, 0] - 0.05, late[:, 0], arm.table[:, tau])
    short = late[:400]

    def found(**tables):
        case = logs_of(arm, **tables)
        return {f.log: f for f in examine(case, checks=[EFFORT_DELAY]).findings}

    alone = logs_of(arm, b=short)
    assert not judge_log(alone, alone.logs[0]).winners
    both = found(a=late, b=short)
    assert [f.severity for f in both.values()] == [Severity.WRONG] * 2
    assert {f.fix.edits[0].value for f in both.values()} == {0.05}
    assert "known from a, for this log as well" in both["b"].figure
    assert "known from" not in both["a"].figure
    clean = found(a=late, b=short, c=arm.table)
    assert clean["c"].severity == Severity.OK
    assert not clean["a"].fix.edits and "c does not require another" in clean["a"].fix.says


def test_a_sign_that_a_log_cannot_show_is_that_of_the_others(arm):
    turned = arm.table.copy()
    turned[:, arm.at(TAU)[2]] *= -1.0
    still = arm.table.copy()
    still[:, arm.at(TAU)[2]] = 0.0  # a dead column has no sign
    case = logs_of(arm, a=turned, b=still)
    found = {f.log: f for f in examine(case, checks=[EFFORT_SIGN]).findings}
    assert "cannot show" in found["b"].figure and found["b"].severity == Severity.DOUBTFUL
    assert {tuple(f.fix.edits[0].value) for f in found.values()} == {(1.0, 1.0, -1.0)}


def test_a_finding_says_its_log_bayes_factor_and_what_it_needs(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)[1]] *= -1.0
    (found,) = (f for f in arm.examined(table, known=False).findings if f.severity)
    factor, least, sure = (
        float(x)
        for x in re.search(
            r"log Bayes factor (\d+) \(doubtful from (\d+), wrong from (\d+)\)", found.figure
        ).groups()
    )
    assert (least, sure) == (LIKELY, SURE) and factor >= SURE


@pytest.mark.parametrize(("known", "least"), [(True, "7.5"), (False, "40")])
def test_a_delay_is_excluded_down_to_what_is_looked_for(arm, known, least):
    found = arm.examined(arm.table, known=known).findings
    says = next(f.says for f in found if f.check == "effort delay")
    assert says.startswith(f"efforts have no common delay of {least} ms or more")


@pytest.mark.slow
def test_order_and_kind_are_searched_together(six):
    order, table = [1, 2, 0, 3, 5, 4], six.table.copy()
    for pattern in (Q, DQ, TAU):
        table[:, six.at(pattern)] = six.table[:, np.array(six.at(pattern))[order]]
    table[:, six.at(TAU)] /= np.array([9.0, 12.0, 7.5, 11.0, 6.0, 8.0])[order]
    found = six.examined(table, known=False)
    assert wrong(found) == ["joint order", "effort kind"]
    back = np.argsort(order)
    assert edits(found) == {
        "signals.position": names(Q, back),
        "signals.velocity": names(DQ, back),
        "signals.effort.columns": names(TAU, back),
    }


@pytest.mark.slow
def test_all_signs_of_efforts_and_a_unit_are_found_together(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)] *= -1000.0
    found = arm.examined(table, known=False)
    assert "effort sign" in wrong(found)
    written = edits(found)
    unit = {"Nm": 1.0, "mNm": 1e-3}[written.get("signals.effort.unit", "Nm")]
    assert unit * np.array(written["signals.effort.gain"]) == pytest.approx([-1e-3] * 3)


def test_a_gain_of_one_joint_is_found_but_not_written(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)[1]] *= 0.02
    found = arm.examined(table, known=False)
    assert wrong(found) == ["effort kind"] and not found.edits


@pytest.mark.slow
def test_one_sign_is_not_hidden_by_wrong_masses(six):
    nominal_times(six, 0.65)
    table = six.table.copy()
    table[:, six.at(TAU)[1]] *= -1.0
    found = six.examined(table, known=False)
    assert wrong(found) == ["effort sign"]
    assert edits(found)["signals.effort.gain"] == [1.0, -1.0, 1.0, 1.0, 1.0, 1.0]


@pytest.mark.slow
def test_efforts_alone_in_another_order_are_not_hidden_by_wrong_masses(six):
    nominal_times(six, 0.65)
    order, table = [0, 2, 1, 3, 4, 5], six.table.copy()
    table[:, six.at(TAU)] = six.table[:, np.array(six.at(TAU))[order]]
    found = six.examined(table, known=False)
    assert wrong(found) == ["joint order"]
    assert edits(found) == {"signals.effort.columns": names(TAU, order)}


def open_ones(found) -> list[str]:
    return [f.check for f in found.findings if not f.answered]


@pytest.mark.parametrize("factor", [0.65, 1.0])
def test_a_nominal_model_does_not_say_that_a_loaded_arm_is_empty(arm, factor):
    nominal_times(arm, factor)
    found = arm.examined(with_payload(arm, 1.0), known=False)
    finding = next(f for f in found.findings if f.check == "payload")
    assert finding.severity or not finding.answered
    assert "no error" not in check_headline(found)


def test_a_right_nominal_model_answers_what_a_wrong_one_leaves_open(arm):
    m, known = arm.motion, effort_predictor(None, arm.robot)
    torque = known.torque(m.q.T, m.dq.T, m.ddq.T, arm.robot.gravity).T
    table, noise = arm.table.copy(), np.random.default_rng(0).standard_normal(torque.shape)
    table[:, arm.at(TAU)] = torque + m.dq + 0.01 * torque.std(axis=0) * noise
    found = arm.examined(table, known=False)
    assert found.severity == Severity.OK
    assert not {"payload", "mounting", "joint order", "effort sign"} & set(open_ones(found))


def test_efforts_that_are_off_leave_unit_gain_and_payload_open(arm):
    table = arm.table.copy()
    table[:, arm.at(TAU)] /= GAINS
    found = arm.examined(table, known=False)
    assert {"effort unit", "gain", "payload"} <= set(open_ones(found))


@pytest.mark.slow
def test_an_order_that_rests_the_joint_in_motion_is_no_explanation(arm):
    table = arm.table.copy()
    still = [j for j in range(3) if j != 1]
    for pattern, value in ((Q, 0.3), (DQ, 0.0)):
        table[:, np.array(arm.at(pattern))[still]] = value
    table[:, arm.at(TAU)] *= -40.0
    case = arm.case(table, known=False)
    declared = ranking(case, case.logs[0]).declared.reading
    for order in ((2, 1, 0),):
        assert declared.changed(position=order).keeps_evidence
    assert not declared.changed(position=(1, 0, 2)).keeps_evidence
    assert not declared.changed(effort=(0, 2, 1)).keeps_evidence
    found = examine(case, checks=MODEL_BASED)
    assert "joint order" not in wrong(found)
    assert not {"signals.position", "signals.effort.columns"} & set(edits(found))


@pytest.mark.slow
def test_gains_that_no_log_fixes_are_doubtful(arm):
    text = edited(in_amperes(arm), [Edit(("signals", "effort", "gain"), "identify")])
    found = arm.examined(arm.table, text, known=False)
    finding = next(f for f in found.findings if f.check == "gain")
    assert finding.severity == Severity.DOUBTFUL and "nothing determines the scale" in finding.says
    assert finding.fix is not None and "--payload-mass" in finding.fix.says
    case = arm.case(arm.table, text, known=False)
    assert "identify demo_arm.toml log --loaded" in _listed_sources(case, sure=True)
    assert "demo_arm.toml LOG... --loaded" in _listed_sources(
        replace(case, logs=case.logs * 2), sure=True
    )
    one = ["identify", 12.0, "identify"]
    text = edited(in_amperes(arm), [Edit(("signals", "effort", "gain"), one)])
    table = arm.table.copy()
    table[:, arm.at(TAU)] /= GAINS
    found = arm.examined(table, text, known=False)
    finding = next(f for f in found.findings if f.check == "gain")
    assert finding.severity == Severity.OK or "do not show the gain" in finding.says
    assert {"gain", "payload"} <= set(open_ones(found))


def test_an_order_is_written_with_a_margin_only(arm, monkeypatch):
    order, table = [0, 2, 1], arm.table.copy()
    table[:, arm.at(TAU)] = arm.table[:, np.array(arm.at(TAU))[order]]
    case = arm.case(table, known=False)
    ((hypothesis, severity),) = judge_log(case, case.logs[0]).winners
    assert hypothesis.fixed and severity == Severity.WRONG
    monkeypatch.setattr(verdict_of_log, "SURE", 1e9)
    case = arm.case(table, known=False)
    ((hypothesis, severity),) = judge_log(case, case.logs[0]).winners
    assert not hypothesis.fixed and severity == Severity.DOUBTFUL
    assert "efforts in the order" in hypothesis.says


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gravity", "factor"), [("[0.0, 0.0, 9.81]", 2.0), ("[3.355, 0.0, -9.218]", 0.5)]
)
def test_gravity_declared_elsewhere_is_found_whatever_links_weigh(arm, gravity, factor):
    nominal_times(arm, factor)
    text = arm.text.replace("[robot]", f"[robot]\ngravity = {gravity}", 1)
    found = arm.examined(arm.table, text, known=False)
    assert wrong(found) == ["mounting"]
    direction = np.array(edits(found)["robot.gravity"])
    assert direction @ [0.0, 0.0, -1.0] / np.linalg.norm(direction) > np.cos(np.deg2rad(1.0))


def with_one_unknown_gain(arm, gains=GAINS):
    """The text of the robot file and a log in amperes; the last gain is to be identified."""
    table = arm.table.copy()
    table[:, arm.at(TAU)] /= GAINS
    gain = [*gains[:-1].tolist(), "identify"]
    return table, edited(in_amperes(arm), [Edit(("signals", "effort", "gain"), gain)])


@pytest.mark.slow
def test_reversed_gravity_is_found_beside_an_unknown_gain(arm):
    table, text = with_one_unknown_gain(arm)
    text = text.replace("[robot]", "[robot]\ngravity = [0.0, 0.0, 9.81]", 1)
    found = arm.examined(table, text, known=False)
    assert wrong(found) == ["mounting"]
    assert edits(found)["robot.gravity"] == [0.0, 0.0, -9.81]


@pytest.mark.slow
@pytest.mark.parametrize("turned", [(1,), (0, 1)])
def test_a_wrong_sign_is_found_beside_an_unknown_gain(arm, turned):
    gains = np.where(np.isin(np.arange(3), turned), -GAINS, GAINS)
    table, text = with_one_unknown_gain(arm, gains)
    found = arm.examined(table, text, known=False)
    assert set(wrong(found)) == {"effort sign"}
    assert edits(found)["signals.effort.gain"] == [*GAINS[:-1].tolist(), "identify"]


@pytest.mark.slow
def test_exchanged_efforts_are_found_beside_an_unknown_gain(arm):
    table, text = with_one_unknown_gain(arm)
    first, second, _ = arm.at(TAU)
    table[:, [first, second]] = table[:, [second, first]]
    found = arm.examined(table, text, known=False)
    assert wrong(found) == ["joint order"]


def test_a_right_file_with_an_unknown_gain_is_ok(arm):
    found = arm.examined(*with_one_unknown_gain(arm), known=False)
    assert not wrong(found)


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "mounted"), [(0.7, ""), (1.5, "\ngravity = [9.81, 0.0, 0.0]")])
def test_efforts_in_kilonewtonmetres_are_a_unit_not_a_gain(arm, factor, mounted):
    nominal_times(arm, factor)
    table = arm.table.copy()
    table[:, arm.at(TAU)] *= 1e-3
    text = arm.text.replace("[robot]", "[robot]" + mounted, 1)
    found = arm.examined(table, text, known=False)
    if mounted:
        assert set(wrong(found)) == {"mounting", "effort unit"}
        assert edits(found)["signals.effort.gain"] == [1000.0] * 3
        return
    assert wrong(found) == ["effort unit"]
    assert edits(found) == {"signals.effort.gain": [1000.0] * 3}


@pytest.mark.parametrize(
    ("factors", "says"),
    [
        ((180.0, 240.0, 150.0), "those of motors"),  # ratios of an industrial robot's gears
        ((160.0, 900.0, 1100.0), "unknown factors"),  # position errors over unlike stiffnesses
    ],
)
def test_a_thousand_is_not_written_where_a_joint_needs_another_factor(arm, factors, says):
    table = arm.table.copy()
    table[:, arm.at(TAU)] /= factors
    found = arm.examined(table, known=False)
    (kind,) = (f for f in found.findings if f.check == "effort kind")
    assert wrong(found) == ["effort kind"] and not found.edits
    intervals = re.findall(r" ([\d.]+) \(([\d.]+) to ([\d.]+)\)", kind.says)
    assert says in kind.says and len(intervals) >= 1
    assert all(float(low) < float(best) < float(high) for best, low, high in intervals)


@pytest.mark.parametrize("declared", [True, False])
def test_a_placeholder_for_speed_makes_no_degrees(arm, declared):
    urdf = arm.path.parent / "demo_arm.urdf"
    urdf.write_text(re.sub(r'velocity="[^"]*"', 'velocity="0.1"', urdf.read_text()))
    text = re.sub(r"\n\[robot\.limits.*?(?=\n\[)", "", arm.text, flags=re.DOTALL)
    if not declared:
        text = re.sub(r"\nvelocity = .*", "", text)
    found = arm.examined(arm.table, text, known=False)
    assert not {"position", "velocity", "excitation"} & {
        f.check for f in found.findings if f.severity
    }


@pytest.mark.slow
def test_a_constant_pull_is_not_called_a_mounting(arm):
    case = arm.case(arm.table, known=False)
    likelihood = ranking(case, case.logs[0]).likelihood
    pulls = np.linalg.norm(likelihood.size) * np.array([0.5, 0.0, 0.3])
    table = arm.table.copy()
    q = table[:, arm.at(Q)]
    table[:, arm.at(TAU)] += pulls * np.cos(2.0 * q + 0.7)
    found = arm.examined(table, known=False)
    assert not any(f.check == "mounting" and f.severity is Severity.WRONG for f in found.findings)


def held_up(arm, share: float, heavier: float) -> np.ndarray:
    """The log of an arm whose links weigh more, less a share of the gravity of the nominal ones."""
    m, known = arm.motion, effort_predictor(None, arm.robot)
    q, dq, ddq = m.q.T, m.dq.T, m.ddq.T
    nominal = known.torque(q, dq, ddq, arm.robot.gravity)
    weight = np.einsum("a,ajb->jb", arm.robot.gravity, known.pulls(q))
    noise = 0.02 * nominal.std(axis=1)[:, None] * np.random.default_rng(0).standard_normal(q.shape)
    table = arm.table.copy()
    table[:, arm.at(TAU)] = (heavier * nominal + dq + noise - share * weight).T
    return table


def test_the_effort_that_holds_the_nominal_bodies_is_added_to_that_logged(arm):
    """Any bodies under gravity, their weight taken away and added again, fit as they did."""
    found = []
    for share in (0.0, 0.6, 1.0):
        case = arm.case(held_up(arm, share, 0.8), known=False)
        likelihood = ranking(case, case.logs[0]).likelihood
        of = EvidenceOfLog(likelihood, np.zeros(3, dtype=np.bool_))
        reading = likelihood.declared.changed(held=share)
        products = of._products_of(reading)
        efforts = np.sqrt(products.logged(reading)[1])
        (evidence,) = of.of([reading])
        rms = np.sqrt(products.logged(reading)[2])
        found.append((efforts, products.nominal(reading.changed(held=0.0)), evidence.scale))
        assert (evidence.misfits * rms < 0.06 * efforts).all()
    for one in found[1:]:
        np.testing.assert_allclose(one[0], found[0][0], rtol=1e-6)
        np.testing.assert_allclose(one[1], found[0][1], rtol=1e-6)
        assert one[2] == pytest.approx(found[0][2], rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "heavier", "gravity"),
    [
        (1.0, 0.7, ""),
        (1.0, 0.7, "[9.81, 0.0, 0.0]"),
        (1.0, 1.4, "[0.0, 0.0, 9.81]"),
        (0.8, 0.7, ""),
        (0.6, 0.7, "[9.81, 0.0, 0.0]"),
    ],
)
def test_the_gravity_that_a_controller_removes_is_no_mounting(arm, share, heavier, gravity):
    mounted = f"[robot]\ngravity = {gravity}" if gravity else "[robot]"
    text = arm.text.replace("[robot]", mounted, 1)
    found = arm.examined(held_up(arm, share, heavier), text, known=False)
    assert "mounting" not in wrong(found)
    assert not {"robot.gravity", "robot.mounting"} & set(edits(found))
    if share == 1.0:
        kind = next(f for f in found.findings if f.check == "effort kind")
        assert kind.severity == Severity.DOUBTFUL and not found.edits
        assert "lack the gravity of the model file's masses" in kind.says
        assert "the gravity torque that the controller subtracts" in kind.fix.says


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_the_gravity_of_the_true_bodies_that_a_controller_removes_is_written(arm, factor):
    nominal_times(arm, factor)
    found = arm.examined(without_gravity(arm), known=False)
    assert wrong(found) == ["effort kind"]
    assert edits(found) == {"signals.effort.kind": "gravity_compensated_torque"}


@pytest.mark.parametrize("size", [0.0, 1e-12])
def test_efforts_of_no_size_end_in_a_finding(arm, size):
    table = arm.table.copy()
    table[:, arm.at(TAU)] *= size
    found = arm.examined(table, known=False)
    assert not found.edits and found.severity


@pytest.mark.slow
@pytest.mark.parametrize("lean", [0.0, 1.5])
def test_a_mounting_that_leans_is_proposed_as_it_is(arm, lean):
    tilt = np.deg2rad(lean)
    true = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    robot = replace(arm.truth.robot, gravity=true)
    torque = Model(robot, arm.truth.model.terms).at(arm.truth.values).torque(arm.motion)
    noise = np.random.default_rng(0).standard_normal(torque.shape)
    table = arm.table.copy()
    table[:, arm.at(TAU)] = torque + 0.01 * torque.std(axis=0) * noise
    text = arm.text.replace("[robot]", "[robot]\ngravity = [0.0, 9.81, 0.0]", 1)
    found = np.array(edits(arm.examined(table, text, known=False))["robot.gravity"])
    if lean == 0.0:
        np.testing.assert_array_equal(found, [0.0, 0.0, -9.81])
    else:
        np.testing.assert_allclose(found, true, atol=0.02)


@pytest.mark.parametrize(
    ("misfit", "free", "hides"), [(15.0, 8.0, True), (15.0, 2.0, False), (15.0, None, True)]
)
def test_a_misfit_hides_faults_unless_other_link_inertias_explain_it(
    misfit: float, free: float | None, hides: bool
) -> None:
    best = SimpleNamespace(evidence=SimpleNamespace(percent=free))
    search = None if free is None else SimpleNamespace(best=best)
    last = SimpleNamespace(reading=SimpleNamespace(percent=misfit))
    decision = cast(Any, SimpleNamespace(last=last, search=search))
    assert misfit_hides(decision) == hides

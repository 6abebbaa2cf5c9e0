"""Contact from residuals: events, links, and calibration runs that contain contact."""

from dataclasses import replace

import numpy as np
import pytest

from invented import tree
from steelyard.base.errors import DataError, LogError
from steelyard.estimate.external.contact_thresholds import ContactThresholds
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    ResidualTrace,
    supported_rate,
)
from steelyard.uses.contact.contact import contacts_in, links_carried_by, without_contact
from steelyard.uses.effort_plausibility import refuse_other_efforts, refuse_without

ROBOT = tree()
N = ROBOT.n
EDGES = np.tile([0.01, 0.2, 0.8], (N, 1))
SIGMA = np.ones(N)
STEP = 0.02


def trace(name: str, seconds: float, seed: int) -> ResidualTrace:
    """Correlated noise on all joints, which move at changing speeds."""
    rng = np.random.default_rng(seed)
    count = int(seconds / STEP)
    kernel = np.exp(-np.arange(15) / 3.0)
    white = rng.standard_t(5, (N, count))
    residual = np.array([np.convolve(row, kernel, "same") for row in white])
    speed = np.repeat(rng.uniform(0.05, 1.5, (N, count // 25 + 1)), 25, axis=1)[:, :count]
    t = np.arange(count) * STEP
    return ResidualTrace(name, t, STEP, residual, speed, speed, residual, np.zeros((2, N, count)))


def pushed(
    free: ResidualTrace, start: float, stop: float, joint: int, size: float
) -> ResidualTrace:
    """The same with a push."""
    inside = (free.t >= start) & (free.t < stop)
    free.residual[joint, inside] += size
    return free


def limits(value: float) -> ContactThresholds:
    own = ((True,) * 5,) * N
    return ContactThresholds(EDGES, 8.0, 1.0, 60.0, np.full((N, 5), value), own, np.full(N, np.nan))


def silent(seconds: float = 10.0) -> ResidualTrace:
    count = int(seconds / STEP)
    zero = np.zeros((N, count))
    return ResidualTrace(
        "run", np.arange(count) * STEP, STEP, zero.copy(), zero, zero, zero, np.zeros((2, N, count))
    )


def test_events_have_start_end_size_and_joints() -> None:
    run = pushed(silent(), 2.0, 3.0, 1, -4.0)
    run = pushed(run, 2.2, 3.1, 0, 2.0)
    run = pushed(run, 7.0, 7.5, 0, 1.5)
    first, second = contacts_in(run, limits(1.0), ROBOT, 0.5 * SIGMA)
    assert (first.start, first.end) == (pytest.approx(2.0), pytest.approx(3.08))
    assert [(load.joint, load.peak, load.sigmas, load.ratio) for load in first.joints] == [
        (ROBOT.joint_names[1], -4.0, 8.0, 4.0),
        (ROBOT.joint_names[0], 2.0, 4.0, 2.0),
    ]
    assert (second.start, second.joints[0].joint) == (pytest.approx(7.0), ROBOT.joint_names[0])


def test_an_event_lasts_until_half_of_its_threshold() -> None:
    run = pushed(silent(), 2.0, 2.5, 0, 2.0)
    run = pushed(run, 2.5, 4.0, 0, 0.6)
    run = pushed(run, 4.0, 5.0, 0, 0.4)
    (event,) = contacts_in(run, limits(1.0), ROBOT, SIGMA)
    assert event.end == pytest.approx(4.0 - STEP)


def test_a_gap_in_the_log_ends_an_event() -> None:
    run = pushed(silent(), 2.0, 6.0, 0, 2.0)
    run = run.of((run.t < 3.0) | (run.t > 5.0))
    assert [round(event.end, 2) for event in contacts_in(run, limits(1.0), ROBOT, SIGMA)] == [
        2.98,
        5.98,
    ]


def test_a_push_within_the_dead_zone_is_a_change_at_rest() -> None:
    run = pushed(silent(), 0.0, 10.0, 0, 20.0)
    run = pushed(run, 4.0, 4.6, 0, 3.0)
    within = replace(limits(30.0), changes=np.full(N, 2.0))
    (event,) = contacts_in(run, within, ROBOT, SIGMA)
    assert (event.start, event.known) == (pytest.approx(4.0), pytest.approx(4.2))
    (load,) = event.joints
    assert load.change and load.peak == pytest.approx(3.0, rel=0.02)
    assert load.ratio == pytest.approx(1.5, rel=0.02)
    assert contacts_in(run, limits(30.0), ROBOT, SIGMA) == ()


def test_the_test_that_is_exceeded_more_gives_the_size() -> None:
    run = pushed(silent(), 0.0, 10.0, 0, 4.0)
    run = pushed(run, 4.0, 4.6, 0, 3.0)
    both = replace(limits(5.0), changes=np.full(N, 2.5))
    (event,) = contacts_in(run, both, ROBOT, SIGMA)
    assert not event.joints[0].change and event.joints[0].peak == pytest.approx(7.0)
    assert event.known == event.start == pytest.approx(4.0)


def test_links_are_those_that_all_loaded_joints_carry() -> None:
    names = [body.name for body in ROBOT.bodies]
    assert links_carried_by(ROBOT, [ROBOT.bodies[0].coordinate]) == tuple(names)
    leaf = ROBOT.bodies[-1]
    carried = links_carried_by(ROBOT, [ROBOT.bodies[0].coordinate, leaf.coordinate])
    assert carried[-1] == leaf.name and len(carried) < len(names)


def test_links_of_two_branches_have_no_common_contact() -> None:
    leaves = [k for k in range(len(ROBOT.bodies)) if all(body.parent != k for body in ROBOT.bodies)]
    joints = [ROBOT.bodies[k].coordinate for k in leaves]
    assert len(leaves) > 1 and links_carried_by(ROBOT, joints) == ()


def test_contact_in_calibration_runs_is_found_and_left_out() -> None:
    runs = [trace(f"run{k}", 60.0, k) for k in range(4)]
    clean, none = without_contact(runs, EDGES, 8.0, ROBOT, SIGMA)
    assert none == ()
    runs[2] = pushed(runs[2], 20.0, 21.5, 1, 300.0)
    runs[2] = pushed(runs[2], 40.0, 40.5, 0, -300.0)
    found, suspected = without_contact(runs, EDGES, 8.0, ROBOT, SIGMA)
    assert [one.run for one in suspected] == ["run2", "run2"]
    assert [round(one.event.start) for one in suspected] == [20, 40]
    assert "run2 contains contact at 20.5 to 21.5 s" in suspected[0].text
    assert 60.0 * 4 - 12.0 < found.duration < 60.0 * 4 - 4.0
    ratio = found.thresholds(20.0).limits / clean.thresholds(20.0).limits
    assert 0.8 < np.nanmin(ratio) and np.nanmax(ratio) < 1.25


def test_pushes_of_a_run_do_not_hide_each_other() -> None:
    runs = [trace("free", 90.0, 31), trace("pushed", 60.0, 32)]
    for start in (8.0, 22.0, 37.0, 51.0):
        runs[1] = pushed(runs[1], start, start + 1.0, 0, 300.0)
    _, suspected = without_contact(runs, EDGES, 8.0, ROBOT, SIGMA)
    assert [round(one.event.start) for one in suspected] == [8, 22, 37, 51]
    assert {one.run for one in suspected} == {"pushed"}


def test_a_single_calibration_run_is_compared_with_its_own_stretches() -> None:
    run = pushed(trace("only", 200.0, 9), 30.0, 31.0, 0, 300.0)
    _, suspected = without_contact([run], EDGES, 8.0, ROBOT, SIGMA)
    assert [round(one.event.start) for one in suspected] == [30]


def test_free_runs_are_hardly_ever_suspected() -> None:
    found = [
        without_contact(
            [trace("a", 60.0, 2 * k), trace("b", 60.0, 2 * k + 1)], EDGES, 8.0, ROBOT, SIGMA
        )
        for k in range(20, 28)
    ]
    assert sum(bool(suspected) for _, suspected in found) <= 1  # 0.16 are expected


def test_rates_beyond_the_calibration_are_refused() -> None:
    peaks = trace("a", 360.0, 1).peaks(EDGES, 8.0)
    assert peaks.lowest_rate == pytest.approx(1.0)
    assert supported_rate(peaks, None) == pytest.approx(1.0)
    assert supported_rate(peaks, 3.0) == 3.0
    with pytest.raises(DataError, match="calibrate with 12 min of free motion"):
        supported_rate(peaks, 0.5)
    with pytest.raises(DataError, match="too short"):
        supported_rate(silent(0.5).peaks(EDGES, 8.0), 100.0)


@pytest.mark.parametrize(("part", "name"), [(0, "gravity"), (1, "friction")])
def test_efforts_that_lack_a_part_are_refused(part: int, name: str) -> None:
    run = trace("run", 60.0, 4)
    run.parts[part] = 20.0 * np.sin(np.outer(np.arange(1, N + 1), run.t))
    refuse_without(run, SIGMA, ROBOT.joint_names)
    run.residual[:] -= run.parts[part]
    with pytest.raises(LogError, match=f"the efforts lack (9.|10.) % of the {name}"):
        refuse_without(run, SIGMA, ROBOT.joint_names)


@pytest.mark.parametrize(("share", "posture"), [(0.75, True), (1.0, False)])
def test_a_part_of_gravity_may_be_lacking_for_another_posture(share: float, posture: bool) -> None:
    run = trace("run", 60.0, 4)
    run.parts[0] = 20.0 * np.sin(np.outer(np.arange(1, N + 1), run.t))
    run.residual[:] -= share * run.parts[0]
    with pytest.raises(LogError, match="the efforts lack") as caught:
        refuse_without(run, SIGMA, ROBOT.joint_names)
    assert ("zeros of joint positions" in caught.value.fix) == posture


def test_efforts_that_the_model_does_not_explain_are_refused() -> None:
    run = trace("run", 60.0, 4)
    own = 40.0 * np.sin(np.outer(np.arange(1, N + 1), run.t))
    refuse_other_efforts(replace(run, measured=own + run.residual), SIGMA, ROBOT.joint_names)
    other = replace(run, residual=own + 30.0, measured=0.1 * own + 30.0)
    with pytest.raises(
        LogError, match="the model explains 0 % of the squared efforts of this log, less than 25 %"
    ):
        refuse_other_efforts(other, SIGMA, ROBOT.joint_names)
    expected = np.full(N, 30.0)
    refuse_other_efforts(other, SIGMA, ROBOT.joint_names, expected)
    with pytest.raises(LogError, match="less than 25 %"):
        refuse_other_efforts(other, SIGMA, ROBOT.joint_names, 0.5 * expected)
    resting = replace(run, residual=own / 20.0, measured=own / 20.0)
    refuse_other_efforts(resting, SIGMA, ROBOT.joint_names)


def moved() -> tuple[ResidualTrace, np.ndarray]:
    """A run whose efforts the model explains, and the predicted efforts."""
    run = trace("run", 60.0, 4)
    own = 40.0 * np.sin(np.outer(np.arange(1, N + 1), run.t))
    return replace(run, measured=own + run.residual), own


def test_a_reversed_sign_of_efforts_is_named() -> None:
    run, own = moved()
    refuse_without(run, SIGMA, ROBOT.joint_names)
    reversed_ = replace(run, residual=run.residual - 2.0 * own, measured=run.measured - 2.0 * own)
    with pytest.raises(LogError, match="the efforts have the reversed sign"):
        refuse_without(reversed_, SIGMA, ROBOT.joint_names)
    own[1:] = 0.0
    one = replace(run, residual=run.residual - 2.0 * own, measured=run.measured - 2.0 * own)
    name = ROBOT.joint_names[0]
    with pytest.raises(LogError, match=f"the effort of {name} has the reversed sign"):
        refuse_without(one, SIGMA, ROBOT.joint_names)
    absent = replace(run, residual=run.residual - own, measured=run.measured - own)
    refuse_without(absent, SIGMA, ROBOT.joint_names)


@pytest.mark.parametrize(("part", "what"), [(0, "efforts"), (1, "velocities")])
def test_the_opposite_of_a_part_is_a_reversed_sign(part: int, what: str) -> None:
    run, own = moved()
    run.parts[part] = 0.5 * own[::-1]
    opposite = replace(run, residual=run.residual - 2.0 * run.parts[part])
    with pytest.raises(LogError, match=f"the {what} have the reversed sign: .*contain minus"):
        refuse_without(opposite, SIGMA, ROBOT.joint_names)


def test_an_effort_that_never_changes_is_not_measured() -> None:
    run, own = moved()
    run.measured[1], run.residual[1] = 3.0, 3.0 - own[1]
    name = ROBOT.joint_names[1]
    with pytest.raises(LogError, match=f"the effort of {name} never changes"):
        refuse_without(run, SIGMA, ROBOT.joint_names)
    run.residual[1] = 1.0
    refuse_without(run, SIGMA, ROBOT.joint_names)

"""Levels and headlines of verdicts, from the errors of joints."""

from dataclasses import replace

import pytest

from steelyard.identify.verdict_and_next_steps import verdict


@pytest.fixture
def judged(usual):
    """Verdicts on runs of some joints, without limitations."""
    score = usual.scores[0]

    def of(*joints):
        named = tuple(replace(one, joint=f"joint_{n}") for n, one in enumerate(joints, 1))
        table = tuple(replace(score.joints[0], joint=one.joint) for one in named)
        run = replace(score, joints=table, errors=replace(score.errors, joints=named))
        return verdict(replace(usual, scores=(run,), limitations=()))

    return of


def test_good_says_for_how_many_joints_and_needs_half_of_them(usual, judged):
    shoulder, elbow = usual.scores[0].errors.joints
    light = replace(elbow, used=1.0, error=0.3, least=0.0)
    assert judged(shoulder, elbow, elbow).line.startswith("GOOD: Predicts")
    most = judged(shoulder, elbow, light)
    assert most.line.startswith("GOOD for 2 of 3 joints: Predicts unseen motion with an error of")
    assert most.line.endswith("(joint_3 30.0\u00a0%)")
    assert most.to_dict()["scope"] == "2 of 3 joints"
    assert judged(shoulder, light).scope == "1 of 2 joints"
    assert judged(shoulder, light, light).line.startswith("FAIR: Predicts")
    resting = replace(light, counted=False)
    assert judged(shoulder, elbow, light, resting).scope == "2 of 3 joints"


def test_good_names_all_other_joints(usual, judged):
    shoulder, elbow = usual.scores[0].errors.joints
    light = [replace(elbow, used=1.0, error=e, least=0.0) for e in (0.2, 0.3, 0.4, 0.5)]
    most = judged(*[shoulder] * 5, *light)
    worse = [f"joint_{9 - k} {50 - 10 * k}.0\u00a0%" for k in range(4)]
    assert most.line.startswith("GOOD for 5 of 9 joints: ") and list(most.worse) == worse
    assert most.line.endswith(f"({', '.join(worse)})")
    assert most.to_dict()["worse"] == worse
    fair = judged(shoulder, *light)
    assert fair.line.startswith("FAIR: ") and fair.line.endswith(" and 1 more)")


def test_half_of_the_loaded_joints_no_better_than_zero_is_poor(usual, judged):
    shoulder, elbow = usual.scores[0].errors.joints
    lost = replace(elbow, used=1.0, error=0.96, least=0.0)
    poor = judged(shoulder, elbow, lost, lost)
    assert poor.errors[0].percent_of_used < 10.0 and poor.level == "poor"
    says = "POOR: Predicts unseen motion no better than predicting zero at 2 of 4 joints: the error"
    assert poor.line.startswith(says)
    assert poor.line.endswith("(joint_4 96.0\u00a0%, joint_3 96.0\u00a0%)")
    assert judged(shoulder, elbow, elbow, lost).level == "good", "of one in four the line tells"
    idle = replace(elbow, used=0.2, error=0.3, least=0.0)
    assert judged(shoulder, elbow, idle, idle).level == "good", "joints that carry next to nothing"
    resting = replace(lost, counted=False)
    assert judged(shoulder, elbow, lost, resting, resting).level == "good"

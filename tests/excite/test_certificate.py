"""Certificates say what holds of a motion, and nothing that does not."""

import json
from pathlib import Path

import numpy as np
import pytest

from exact_motions import chained, raw_fourier, rest_fourier, several, table
from invented import dh_arm
from steelyard.base.arrays import Array
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import power_limit, torque_limit
from steelyard.excite.constraints.certificate import certify, trajectory_hash
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins, MotionLimits
from steelyard.excite.constraints.tool_workspace import Marker, tool_box
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory, PiecewiseMotion
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model


def motion() -> FourierMotion:
    """Three joints that move gently for eight seconds."""
    free = 0.2 * np.random.default_rng(5).standard_normal((3, 6))
    return FourierMotion.from_free(np.zeros(3), free, 8.0)


def exact_limits(of: ExactTrajectory, share: float = 1.0, jerk: bool = True) -> MotionLimits:
    """Limits that a motion just keeps; speeds times a share."""
    (low, high), *ends = (of.extremes(order) for order in range(4))
    speed, acceleration, most = (np.maximum(-a, b) for a, b in ends)
    return MotionLimits(low, high, share * speed, acceleration, jerk=most if jerk else None)


def walls(*, low: float = -5.0, effort: float = 1e3) -> list[Constraint]:
    """A tool box, and limits of torque and power."""
    robot = dh_arm()
    arm = Model(robot, (RigidBody(),)).prior
    assert arm is not None
    box = tool_box(robot, Marker(robot.bodies[-1].name), (low, None, None), (5.0, 5.0, 5.0))
    return [
        box,
        torque_limit({"arm": arm}, [effort] * 3),
        power_limit({"arm": arm}, [np.inf] * 3, 1e4),
    ]


def test_a_motion_within_everything_is_certified() -> None:
    of = motion()
    certificate = certify(dh_arm(), of, exact_limits(of), walls())
    assert certificate.holds and certificate.failures == ()
    assert certificate.robot == "dh arm" and certificate.duration == 8.0
    assert [p.name for p in certificate.proofs] == ["tool box", "torque", "power"]
    for proof in certificate.proofs:
        assert len(proof.labels) == len(proof.proven) == len(proof.sampled)
        assert np.all(np.array(proof.proven) <= np.array(proof.sampled))
        assert proof.how.count("time interval") == 1
    units = [(x.quantity, x.unit) for x in certificate.extremes[:4]]
    assert units == [
        ("position", "rad"),
        ("velocity", "rad/s"),
        ("acceleration", "rad/s²"),
        ("jerk", "rad/s³"),
    ]
    assert [x.joint for x in certificate.extremes[::4]] == list(dh_arm().joint_names)


def test_a_speed_beyond_its_limit_is_named() -> None:
    of = motion()
    certificate = certify(dh_arm(), of, exact_limits(of, share=0.99))
    assert not certificate.holds and len(certificate.failures) == 3
    fastest = certificate.extremes[1]
    by = 0.01 * max(-fastest.least, fastest.greatest)
    assert fastest.margin == pytest.approx(-by)
    joint = dh_arm().joint_names[0]
    expected = f"velocity of '{joint}' exceeds its limit by {by:.3g} rad/s"
    assert certificate.failures[0] == expected


def test_without_a_limit_of_jerk_any_will_do() -> None:
    of = motion()
    jerk = certify(dh_arm(), of, exact_limits(of, jerk=False)).extremes[3]
    assert jerk.margin is None and jerk.lower is None and jerk.greatest > 0.0


def test_a_wall_that_is_passed_is_named() -> None:
    of, robot = motion(), dh_arm()
    certificate = certify(robot, of, exact_limits(of), walls(low=0.5, effort=2.0))
    assert not certificate.holds
    box = [line for line in certificate.failures if line.startswith("tool box")]
    seen = -certificate.proofs[0].sampled[0]
    name = robot.bodies[-1].name
    assert box == [f"tool box: x of '{name}' above 0.5 m: violated by {seen:.3g} m"]
    assert any(line.startswith("torque: torque of") for line in certificate.failures)


class Touching(Constraint):
    """A wall that every sample keeps exactly, and of which nothing can be proven."""

    name, labels, unit, activation_distance = "touch", ("first", "second"), "m", np.ones(2)

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        return Margins(np.ones((len(q), 2)))

    def proven(self, trajectory: ExactTrajectory) -> Array:
        return np.array([-np.inf, 0.0])


def test_what_is_not_proven_does_not_hold(tmp_path: Path) -> None:
    certificate = certify(dh_arm(), motion(), exact_limits(motion()), [Touching()])
    assert certificate.failures == ("touch: first: not proven",)
    assert "the whole motion" in certificate.proofs[0].how
    certificate.write(tmp_path / "c.json")
    text = (tmp_path / "c.json").read_text()
    assert "Infinity" not in text and json.loads(text) == certificate.to_dict()
    assert json.loads(text)["holds"] is False
    assert json.loads(text)["constraints"][0]["margins"][0]["proven"] is None


@pytest.mark.slow
@pytest.mark.parametrize("make", [rest_fourier, table, several], ids=lambda make: make.__name__)
def test_files_say_what_was_proven_of_which_motion(make, tmp_path: Path) -> None:
    of, notes = make(np.random.default_rng(3)), ("torque is not limited",)
    certificate = certify(dh_arm(), of, exact_limits(motion()), walls(), notes=notes)
    certificate.write(tmp_path / "certificate.json")
    values = json.loads((tmp_path / "certificate.json").read_text())
    assert values == certificate.to_dict() and values["holds"] == certificate.holds
    assert values["trajectory_sha256"] == trajectory_hash(of) != trajectory_hash(motion())
    assert values["notes"][0] == notes[0]
    assert [x["name"] for x in values["constraints"]] == [wall.name for wall in walls()]


def test_a_jump_of_velocity_is_no_motion() -> None:
    coefficients = np.zeros((2, 4, 3))
    coefficients[0, 1, 1], coefficients[1, 0, 1], coefficients[1, 1, 1] = 0.2, 0.2, -0.2
    of = PiecewiseMotion(np.array([0.0, 2.0, 3.0]), coefficients)
    wide = MotionLimits(np.full(3, -9.0), np.full(3, 9.0), np.full(3, 9.0), np.full(3, 9.0))
    certificate = certify(dh_arm(), of, wide)
    name = dh_arm().joint_names[1]
    assert certificate.failures == (f"velocity of '{name}' jumps by 0.3 rad/s at t = 2 s",)
    assert not certificate.holds
    (jump,) = certificate.to_dict()["jumps"]
    assert (jump["joint"], jump["size"]) == (name, pytest.approx(0.3))


@pytest.mark.parametrize("make", [rest_fourier, raw_fourier, table, several])
@pytest.mark.parametrize("seed", range(5))
def test_smooth_motions_jump_nowhere(make, seed: int) -> None:
    of = make(np.random.default_rng(seed))
    assert certify(dh_arm(), of, exact_limits(of)).jumps == ()


def test_parts_that_do_not_fit_jump() -> None:
    of = chained(np.random.default_rng(1))
    assert len(certify(dh_arm(), of, exact_limits(of)).jumps) == 3


def test_a_motion_that_does_not_rest_at_its_ends_says_so() -> None:
    raw, rest = (make(np.random.default_rng(2)) for make in (raw_fourier, rest_fourier))
    first, last = certify(dh_arm(), raw, exact_limits(raw)).notes
    assert first.startswith("the motion does not start at rest: the robot must already be moving")
    assert last.startswith("the motion does not end at rest")
    assert certify(dh_arm(), rest, exact_limits(rest)).notes == ()


class Near(Touching):
    """Margins that are only lower bounds where they are one metre or more, as of clearances."""

    def proven(self, trajectory: ExactTrajectory) -> Array:
        return np.array([1.5, 0.5])


def test_samples_are_never_reported_below_what_is_proven() -> None:
    proof = certify(dh_arm(), motion(), exact_limits(motion()), [Near()]).proofs[0]
    assert proof.proven == (1.5, 0.5) and proof.sampled == (1.5, 1.0)


def test_the_hash_is_that_of_the_file() -> None:
    values = motion().to_dict()
    backwards = dict(reversed(values.items()))
    assert json.dumps(values) != json.dumps(backwards)

    class Same(FourierMotion):
        def to_dict(self) -> dict[str, object]:
            return backwards

    same = Same(motion().start, motion().sine, motion().cosine, 8.0)
    assert trajectory_hash(same) == trajectory_hash(motion())

"""Zero offsets of joints from invented data, against those that the data were made with."""

import numpy as np
import pytest

from invented import ball, turned
from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.nonlinear.grid_search import InformationOf
from steelyard.estimate.nonlinear.nonlinear_parameters import find_offsets
from steelyard.model.model import Model
from steelyard.robot.robot import Body, Coordinate, Robot

NOISE = 0.02


def arm() -> Robot:
    """Four skew joints, the first along gravity."""
    bodies = tuple(
        Body(
            f"link{k}", f"joint{k}", "revolute", k - 1, np.eye(3) if k == 0 else turned(k),
            [0.1, 0.2, 0.3], [0.0, 0.0, 1.0], k, inertia=ball(k), known=True,
        )
        for k in range(4)
    )  # fmt: skip
    return Robot("arm", bodies, tuple(Coordinate(f"joint{k}", "revolute") for k in range(4)))


ROBOT = arm()
MODEL = Model(ROBOT)


def motion(seed: int, count: int = 2000) -> np.ndarray:
    """Four harmonics at 200 Hz, `(3, n, N)`."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / 200.0
    total = np.zeros((3, ROBOT.n, count))
    for k in range(1, 5):
        w = 0.1 * 2 * np.pi * k
        a, b = 0.8 * rng.normal(size=(2, ROBOT.n, 1)) / k
        wave, quarter = a * np.sin(w * t) + b * np.cos(w * t), a * np.cos(w * t) - b * np.sin(w * t)
        total += np.array([wave, w * quarter, -w * w * wave])
    return total


class Logged:
    """A log of the arm, whose encoders are off by some radians; it is read with other offsets."""

    def __init__(self, true: np.ndarray, seed: int = 0) -> None:
        rng = np.random.default_rng(seed + 50)
        self.motion = motion(seed)
        parameters = [p.prior or rng.uniform(0.3, 1.0) for p in MODEL.parameters]
        values = dict(zip(MODEL.names, parameters, strict=True))
        known = Parameters(MODEL.names, MODEL.units, [values[name] for name in MODEL.names])
        effort = MODEL.at(known).block(*self.motion)
        self.effort = effort + NOISE * rng.normal(size=effort.shape)
        self.logged = self.motion[0] - true[:, None]

    def __call__(self, offsets: np.ndarray) -> InformationOf:
        samples = np.array([self.logged + offsets[:, None], *self.motion[1:]])

        def information_of(regressor: Regressor) -> Information:
            channels = regressor.model.scan()(*samples)
            sums = Accumulator(regressor)(Stretch(*samples, self.effort, None, channels))
            signature = Signature(
                regressor.model.fingerprint, regressor.layout.columns, ("Nm",) * ROBOT.n, "none"
            )
            return Information(
                regressor.layout,
                signature,
                (Window("run", 0.0, 1.0),),
                sums.grams[None],
                sums.absolute[None],
                sums.counts[None],
            )

        return information_of


@pytest.mark.parametrize("size", [0.05, 0.5])
@pytest.mark.parametrize("joint", [1, 2])
def test_an_offset_of_one_joint_is_found_within_its_interval(joint: int, size: float) -> None:
    true = np.zeros(4)
    true[joint] = size
    found = find_offsets(MODEL, Logged(true), np.zeros(4), [True] * 4)
    assert found.converged and found.half_width[joint] < 0.01
    # three other intervals, so that one of 95 % may miss by chance: twice the half-width
    assert abs(found.values[joint] - size) < 2 * found.half_width[joint]


def test_what_no_motion_shows_is_named_and_left_as_given() -> None:
    found = find_offsets(MODEL, Logged(np.array([0.3, 0.1, 0.0, 0.2])), np.zeros(4), [True] * 4)
    assert np.isnan(found.std[[0, 3]]).all() and np.isfinite(found.std[[1, 2]]).all()
    assert found.values[0] == found.values[3] == 0.0
    assert "left as given: joint0, joint3" in found.note
    assert f"joint1 {found.values[1]:.4f} ± {found.half_width[1]:.4f} rad" in found.note
    assert found.to_dict()["half_width"][0] is None


def test_what_is_not_wanted_stays() -> None:
    start = np.array([0.0, 0.1, 0.0, 0.0])
    found = find_offsets(MODEL, Logged(start + [0, 0, 0.2, 0]), start, [False, False, True, False])
    assert found.values[1] == 0.1 and abs(found.values[2] - 0.2) < 2 * found.half_width[2]
    assert "left as given" not in found.note


@pytest.mark.slow
def test_intervals_hold() -> None:
    true, inside = np.array([0.0, 0.2, -0.15, 0.0]), 0
    for seed in range(10):
        found = find_offsets(MODEL, Logged(true, seed), np.zeros(4), [True] * 4)
        inside += int(np.sum(np.abs(found.values - true)[1:3] <= found.half_width[1:3]))
    assert inside >= 17  # of 20; 19 expected


def test_closed_chains_are_refused() -> None:
    closed = ROBOT.changed(
        coordinates=ROBOT.coordinates[:3], passive=ROBOT.coordinates[3:], assembly=np.zeros(4)
    )
    with pytest.raises(DataError, match="closed chains"):
        find_offsets(Model(closed), Logged(np.zeros(4)), np.zeros(3), [True] * 3)

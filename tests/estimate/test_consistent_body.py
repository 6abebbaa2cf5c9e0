"""Payloads as physically consistent bodies, from unconstrained ten numbers."""

import numpy as np
import pytest

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.uses.payload.known_and_consistent_payload_body import (
    ConsistentBody,
    PayloadKnowledge,
    SolidShape,
    consistent_body,
    refuse_contradiction,
)

SIZE = (0.2, 0.1, 0.08)
TRUTH = Inertia.about_com(
    2.5,
    (0.02, -0.03, 0.1),
    2.5 / 12.0 * np.diag([0.1**2 + 0.08**2, 0.2**2 + 0.08**2, 0.2**2 + 0.1**2]),
)
STD = np.array([0.02, *(0.004,) * 3, *(0.03,) * 6])
"""Of the unconstrained numbers: weight and centre are seen well, the inertia is not."""

NOTHING = PayloadKnowledge()


def drawn(seed: int) -> Array:
    return TRUTH.ten + STD * np.random.default_rng(seed).normal(size=10)


def found(free: Array, known: PayloadKnowledge = NOTHING, std: Array = STD) -> ConsistentBody:
    by_data = np.diag(np.where(np.isinf(std), np.nan, std**2))
    return consistent_body(free, np.diag(std**-2.0), by_data, np.zeros((10, 10)), known)


def test_a_possible_estimate_stays_what_it_is() -> None:
    body = found(TRUTH.ten)
    np.testing.assert_allclose(body.ten, TRUTH.ten, atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(body.covariance)), STD)
    assert body.chi_squared == 0.0


@pytest.mark.parametrize("size", [1e4, 1e8, 1e12])
def test_an_inertia_that_the_data_leave_anywhere_is_no_obstacle(size: float) -> None:
    free = drawn(0)
    free[4:] = size * np.array([1.0, 1e-8, 2.0, -3.0, 1e-6, 5.0])
    std = np.array([*STD[:4], *(10.0 * size,) * 6])
    body = found(free, std=std)
    assert Inertia.from_ten(body.ten).flaw() is None
    assert np.all(np.abs(body.ten - free)[:4] < STD[:4])


@pytest.mark.slow
def test_an_impossible_estimate_becomes_a_body_near_it() -> None:
    impossible, inside = 0, np.zeros(10)
    for seed in range(40):
        free = drawn(seed)
        body = found(free)
        assert Inertia.from_ten(body.ten).flaw() is None
        inside += np.abs(body.ten - TRUTH.ten) <= Z95 * np.sqrt(np.diag(body.covariance))
        if Inertia.from_ten(free).flaw() is not None:
            impossible += 1
            assert body.chi_squared > 0.0
            assert np.linalg.norm((body.ten - free) / STD) < 4.5
    assert impossible >= 30
    assert np.all(inside >= 36)


def test_what_is_known_is_met_and_narrows_what_hangs_on_it() -> None:
    free = drawn(3)
    known = PayloadKnowledge(mass=2.5, com=(0.02, -0.03, 0.1), shape=SolidShape.of("box", SIZE))
    loose, tight = found(free), found(free, known)
    centre = Inertia.from_ten(tight.ten).com
    assert tight.ten[0] == pytest.approx(2.5, rel=2e-3)
    np.testing.assert_allclose(centre, TRUTH.com, atol=2e-3)
    before, after = (np.sqrt(np.diag(body.covariance)) for body in (loose, tight))
    assert np.all(after <= before * (1.0 + 1e-9)) and np.all(
        after[[0, 4, 6, 9]] < before[[0, 4, 6, 9]] / 5
    )
    assert np.all(np.abs(tight.ten - TRUTH.ten) < 3.0 * after)


def test_a_shape_says_nothing_about_where_the_body_is() -> None:
    free = drawn(5)
    loose, shaped = found(free), found(free, PayloadKnowledge(shape=SolidShape.of("box", SIZE)))
    assert shaped.covariance[1, 1] == pytest.approx(loose.covariance[1, 1], rel=0.05)
    assert Inertia.from_ten(shaped.ten).com == pytest.approx(Inertia.from_ten(free).com, abs=2e-3)


def test_knowledge_supplies_what_the_data_do_not_see() -> None:
    std = STD.copy()
    std[4:] = np.inf
    free = np.concatenate([TRUTH.ten[:4], np.zeros(6)])
    blind = found(free, std=std)
    assert np.isnan(np.diag(blind.covariance)[4:]).all()
    assert Inertia.from_ten(blind.ten).flaw() is None
    shaped = found(free, PayloadKnowledge(shape=SolidShape.of("box", SIZE)), std)
    assert np.isfinite(shaped.covariance).all()
    assert np.all(np.abs(shaped.ten - TRUTH.ten) < 2.0 * np.sqrt(np.diag(shaped.covariance)))


def test_errors_of_the_model_widen_what_is_not_known() -> None:
    """A common error of scale moves mass and moments together; a known mass removes it."""
    ten = TRUTH.ten
    widening = 0.05**2 * np.outer(ten, ten)
    variances = (0.001 * STD) ** 2
    args = (1.03 * ten, np.diag(1.0 / variances), np.diag(variances) + widening, widening)
    free = consistent_body(*args, NOTHING)
    weighed = consistent_body(*args, PayloadKnowledge(mass=2.5))
    assert np.sqrt(free.covariance[0, 0]) == pytest.approx(0.05 * 2.5, rel=0.01)
    np.testing.assert_allclose(weighed.ten[:4], ten[:4], rtol=3e-3)
    assert weighed.covariance[3, 3] < 0.01 * free.covariance[3, 3]


@pytest.mark.parametrize(
    ("shape", "moments"),
    [
        (SolidShape.of("box", (0.1, 0.2, 0.3)), (0.01 / 12, 0.04 / 12, 0.09 / 12)),
        (SolidShape.of("cylinder", (0.1, 0.3)), (0.01 / 16, 0.01 / 16, 0.09 / 12)),
        (SolidShape.of("sphere", (0.1,)), (0.0005, 0.0005, 0.0005)),
    ],
)
def test_second_moments_of_shapes(shape: SolidShape, moments: tuple[float, ...]) -> None:
    np.testing.assert_allclose(shape.moments, moments)


def test_wrong_knowledge_is_refused() -> None:
    with pytest.raises(DataError, match="dimensions of the box are 0.1, -1, 0.2"):
        SolidShape.of("box", (0.1, -1.0, 0.2))
    with pytest.raises(DataError, match="known mass is -2 kg"):
        PayloadKnowledge(mass=-2.0)
    with pytest.raises(DataError, match="not three numbers"):
        PayloadKnowledge(com=(0.0, float("nan"), 0.0))
    covariance = np.diag(STD**2)
    with pytest.raises(DataError, match="contradict the known mass of 3 kg"):
        refuse_contradiction(TRUTH.ten, covariance, PayloadKnowledge(mass=3.0))
    with pytest.raises(DataError, match="z is given as 0.2 m, the data give 0.1 m"):
        refuse_contradiction(TRUTH.ten, covariance, PayloadKnowledge(com=(0.02, -0.03, 0.2)))
    refuse_contradiction(TRUTH.ten, covariance, PayloadKnowledge(2.53, (0.021, -0.03, 0.1)))

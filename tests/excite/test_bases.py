"""Laws of bases, for all of them."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import BSpline

from steelyard.excite.trajectories.exact_trajectories import ChainedMotion
from steelyard.excite.trajectories.fourier import fourier_shapes, rest_basis
from steelyard.excite.trajectories.motion_families import (
    Basis,
    blended_fourier,
    ramped_fourier,
    raw_fourier,
    reaching,
    rest_fourier,
    splines,
)

START, END = np.array([0.3, -0.2, 1.0]), np.array([-0.5, 0.4, 1.5])
BASES: dict[str, Basis] = {
    "rest": rest_fourier(3, 10.0, 5),
    "rest, from": rest_fourier(3, 8.0, 2, START),
    "rest, from to": rest_fourier(3, 10.0, 5, START, END),
    "raw": raw_fourier(3, 10.0, 1),
    "blended": blended_fourier(3, 10.0, 5, 2, 1.5),
    "blended, from": blended_fourier(3, 10.0, 3, 1, 0.5, START),
    "ramped": ramped_fourier(3, 10.0, 5, 2, 3.0),
    "ramped, from": ramped_fourier(3, 10.0, 5, 1, 5.0, START),
    "cubic": splines(3, 6.0, 7, 3),
    "cubic, from": splines(3, 6.0, 12, 3, START),
    "quintic": splines(3, 6.0, 15, 5),
    "quintic, from to": splines(3, 6.0, 15, 5, START, END),
    "reaching": reaching(3, 4, 1.2, 0.3),
    "reaching, from": reaching(3, 1, 1.2, 0.3, START),
}
ALL = pytest.mark.parametrize("name", list(BASES))


def drawn(basis: Basis, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((basis.joints, basis.count))


@ALL
@pytest.mark.parametrize("order", range(4))
def test_motion_is_offset_and_functions(name: str, order: int) -> None:
    basis = BASES[name]
    x, t = drawn(basis), np.linspace(0.0, basis.duration, 203)
    motion = basis.motion(x)
    assert motion.duration == basis.duration
    shapes, offset = basis.shapes(t, order), basis.offset(t, order)
    assert shapes.shape == (203, basis.count) and offset.shape == (203, 3)
    linear = offset + shapes @ x.T
    size = np.abs(linear).max()
    np.testing.assert_allclose(motion.derivative(t, order), linear, atol=1e-12 * (1.0 + size))


@ALL
def test_all_functions_are_needed(name: str) -> None:
    basis = BASES[name]
    shapes = basis.shapes(np.linspace(0.0, basis.duration, 501), 0)
    assert np.linalg.matrix_rank(shapes) == basis.count


@ALL
def test_starts_and_ends_at_rest(name: str) -> None:
    basis = BASES[name]
    motion = basis.motion(drawn(basis))
    ends = np.array([0.0, basis.duration])
    for order in (1, 2):
        size = np.abs(motion.extremes(order)).max()
        at_rest = np.abs(motion.derivative(ends, order)).max() < 1e-11 * size
        assert at_rest == (name != "raw")


@ALL
def test_starts_and_ends_where_it_says(name: str) -> None:
    basis = BASES[name]
    first, last = basis.motion(drawn(basis)).derivative([0.0, basis.duration], 0)
    if "from" in name:
        np.testing.assert_allclose(first, START, atol=1e-12)
    if "to" in name:
        np.testing.assert_allclose(last, END, atol=1e-12)
    closed = "to" not in name and "open" not in name
    assert np.allclose(first, last, atol=1e-11) is closed


@ALL
def test_still_stands_still(name: str) -> None:
    basis, posture = BASES[name], np.array([0.1, 0.7, -0.4])
    x = basis.still(posture)
    assert x.shape == (3, basis.count)
    least, greatest = basis.motion(x).extremes(0)
    place = START if "from" in name else posture
    if "to" in name:
        assert np.all(least >= np.minimum(START, END) - 1e-12)
        assert np.all(greatest <= np.maximum(START, END) + 1e-12)
    else:
        np.testing.assert_allclose(least, place, atol=1e-12)
        np.testing.assert_allclose(greatest, place, atol=1e-12)


@ALL
def test_highest_frequency_is_in_the_functions(name: str) -> None:
    basis = BASES[name]
    t = np.linspace(0.0, basis.duration, 4001)
    waves = np.diff(np.sign(basis.motion(drawn(basis, 3)).derivative(t[1:-1], 1)), axis=0)
    turns = (np.abs(waves) > 1).sum(axis=0).max()
    assert turns / 2.0 / basis.duration <= 1.5 * basis.highest
    assert 0.5 / basis.duration < basis.highest < 100.0 / basis.duration


@ALL
def test_other_shapes_of_coefficients_are_refused(name: str) -> None:
    basis = BASES[name]
    with pytest.raises(ValueError, match=f"expected an array of 3 x {basis.count}"):
        basis.motion(np.zeros((3, basis.count + 1)))


def test_rest_functions_are_the_null_space() -> None:
    t = np.linspace(0.0, 10.0, 33)
    for order in range(3):
        values = fourier_shapes(t, 10.0, 5, order)
        got = rest_fourier(3, 10.0, 5, START).shapes(t, order)
        np.testing.assert_allclose(got, values @ rest_basis(5), atol=1e-12)
        with_posture = rest_fourier(3, 10.0, 5).shapes(t, order)
        np.testing.assert_allclose(with_posture[:, :-1], got, atol=1e-12)
        np.testing.assert_allclose(with_posture[:, -1], float(order == 0), atol=1e-12)


def test_raw_functions_are_sines_cosines_and_one() -> None:
    t = np.linspace(0.0, 4.0, 9)
    w = 2.0 * np.pi / 4.0
    by_hand = [np.sin(w * t), np.sin(2 * w * t), np.cos(w * t), np.cos(2 * w * t), np.ones(9)]
    np.testing.assert_allclose(
        raw_fourier(1, 4.0, 2).shapes(t, 0), np.transpose(by_hand), atol=1e-14
    )


def test_blend_meets_the_series() -> None:
    basis = blended_fourier(3, 10.0, 4, 2, 1.5, START)
    x = drawn(basis)
    motion, series = basis.motion(x), raw_fourier(3, 10.0, 4).motion(x)
    assert isinstance(motion, ChainedMotion) and motion.duration == 23.0
    np.testing.assert_allclose(motion.breaks, [0.0, 1.5, 21.5, 23.0])
    inside = np.linspace(0.0, 10.0, 41)
    for order in range(3):
        for later in (1.5, 11.5):
            np.testing.assert_allclose(
                motion.derivative(inside + later, order),
                series.derivative(inside, order),
                atol=1e-9,
            )
        for seam in (1.5, 21.5):
            before, after = motion.derivative([seam - 1e-9, seam + 1e-9], order)
            np.testing.assert_allclose(before, after, atol=1e-6)


def test_ramp_is_a_smooth_step_of_the_series() -> None:
    basis = ramped_fourier(3, 10.0, 4, 1, 2.0, START)
    x = drawn(basis)
    t = np.array([0.5, 1.0, 2.0, 5.0, 8.0, 9.0])
    factor = np.array([0.103515625, 0.5, 1.0, 1.0, 1.0, 0.5])[:, None]
    series = raw_fourier(3, 10.0, 4).motion(x).derivative(t, 0)
    np.testing.assert_allclose(
        basis.motion(x).derivative(t, 0), START + factor * (series - START), atol=1e-12
    )


@pytest.mark.parametrize("degree", [3, 5])
def test_splines_are_those_of_scipy(degree: int) -> None:
    basis, t = splines(1, 6.0, 12, degree, [0.5], [2.0]), np.linspace(0.0, 6.0, 101)
    x = drawn(basis)
    points = np.concatenate([[0.5] * 3, x[0], [2.0] * 3])
    inner = np.linspace(0.0, 6.0, 12 - degree + 1)
    knots = np.concatenate([[0.0] * degree, inner, [6.0] * degree])
    spline = BSpline(knots, points, degree)
    for order in range(3):
        got = basis.motion(x).derivative(t, order)[:, 0]
        np.testing.assert_allclose(got, spline(t, order), atol=1e-11)


def test_reaching_passes_its_targets_in_order() -> None:
    basis = reaching(3, 2, 1.0, 0.5, START)
    x = drawn(basis)
    stops = basis.motion(x).derivative([0.0, 1.0, 1.4, 2.5, 3.0, 4.5], 0)
    wanted = [START, x[:, 0], x[:, 0], x[:, 1], x[:, 1], START]
    np.testing.assert_allclose(stops, wanted, atol=1e-12)
    share = 10 * 0.3**3 - 15 * 0.3**4 + 6 * 0.3**5
    got = basis.motion(x).derivative([1.8], 0)[0]
    np.testing.assert_allclose(got, x[:, 0] + share * (x[:, 1] - x[:, 0]), atol=1e-12)


WRONG: list[tuple[Callable[[], Basis], str]] = [
    (lambda: rest_fourier(3, 10.0, 5, START[:2]), "expected an array of 3"),
    (lambda: ramped_fourier(3, 10.0, 2, 0, 1.0), r"0 periods of 10\.0 s are no motion"),
    (lambda: ramped_fourier(3, 10.0, 2, 1, 6.0), "6 s does not fit twice into 10 s"),
    (lambda: reaching(3, 1, 1.0), "1 targets are no motion, 2 or more are"),
    (lambda: reaching(3, 0, 1.0, start=START), "0 targets are no motion, 1 or more are"),
    (lambda: reaching(3, 2, 1.0, -0.5), "the breaks of a motion rise"),
]


@pytest.mark.parametrize("make, words", WRONG)
def test_what_is_no_basis_is_refused(make: Callable[[], Basis], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()

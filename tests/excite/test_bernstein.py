import numpy as np
import pytest

from steelyard.excite.trajectories.exact_trajectories import differentiated, polynomial_extremes


def by_roots(ascending: np.ndarray) -> tuple[float, float]:
    """Extremes from the roots of the derivative, an independent way."""
    slope = np.polynomial.Polynomial(ascending).deriv()
    roots = slope.roots()
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 0) & (roots.real < 1)]
    values = np.polynomial.Polynomial(ascending)(np.concatenate([[0.0, 1.0], inside]))
    return float(values.min()), float(values.max())


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 9, 13])
@pytest.mark.parametrize("seed", range(3))
def test_equals_the_roots_of_the_derivative(degree: int, seed: int) -> None:
    pieces = np.random.default_rng(seed).standard_normal((6, degree + 1, 4))
    least, greatest = polynomial_extremes(pieces)
    for joint in range(4):
        ends = np.array([by_roots(piece[:, joint]) for piece in pieces])
        assert 0.0 <= ends[:, 0].min() - least[joint] < 1e-11
        assert 0.0 <= greatest[joint] - ends[:, 1].max() < 1e-11


@pytest.mark.parametrize("degree", [0, 1, 5])
def test_what_does_not_move_has_one_value(degree: int) -> None:
    pieces = np.zeros((3, degree + 1, 2))
    pieces[:, 0] = [2.5, 0.0]
    least, greatest = polynomial_extremes(pieces)
    np.testing.assert_allclose(least, [2.5, 0.0], rtol=1e-13)
    np.testing.assert_allclose(greatest, [2.5, 0.0], rtol=1e-13)
    assert least[0] < 2.5 < greatest[0]


def test_a_flat_top_is_found() -> None:
    flat = np.polynomial.polynomial.polyfromroots([0.37] * 6)
    least, greatest = polynomial_extremes(np.array([-flat])[:, :, None])
    assert 0.0 <= greatest[0] < 1e-13
    assert least[0] == pytest.approx(-(0.63**6), rel=1e-12)


def test_a_saddle_inside_is_no_extreme() -> None:
    saddle = np.polynomial.polynomial.polyfromroots([0.5] * 3)
    least, greatest = polynomial_extremes(saddle[None, :, None])
    np.testing.assert_allclose([least[0], greatest[0]], [-0.125, 0.125], rtol=1e-12)


def test_derivatives_are_in_time() -> None:
    pieces = np.arange(1.0, 9.0).reshape(2, 4, 1)
    widths = np.array([0.5, 2.0])
    np.testing.assert_allclose(differentiated(pieces, widths, 0), pieces)
    np.testing.assert_allclose(differentiated(pieces, widths, 1)[0, :, 0], [4.0, 12.0, 24.0])
    np.testing.assert_allclose(differentiated(pieces, widths, 2)[1, :, 0], [3.5, 12.0])
    np.testing.assert_array_equal(differentiated(pieces, widths, 4), np.zeros((2, 1, 1)))

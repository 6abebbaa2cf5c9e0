import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from steelyard.robot.inertia_and_placement import (
    Inertia,
    rpy_rotation,
    six_numbers,
    skew,
    symmetric,
)

numbers = st.floats(-2.0, 2.0)
vectors = arrays(np.float64, 3, elements=numbers)


@st.composite
def bodies(draw: st.DrawFn) -> Inertia:
    """A real body: at least four point masses."""
    points = draw(arrays(np.float64, (5, 3), elements=numbers))
    masses = draw(arrays(np.float64, 5, elements=st.floats(0.1, 3.0)))
    total = Inertia.zero()
    for mass, point in zip(masses, points, strict=True):
        total = total + Inertia.about_com(mass, point, 1e-3 * np.eye(3))
    return total


@st.composite
def rotations(draw: st.DrawFn) -> np.ndarray:
    return rpy_rotation(*draw(arrays(np.float64, 3, elements=st.floats(-3.0, 3.0))))


@given(vectors, vectors)
def test_skew_is_the_cross_product(a: np.ndarray, b: np.ndarray) -> None:
    assert np.allclose(skew(a) @ b, np.cross(a, b))


@given(arrays(np.float64, 6, elements=numbers))
def test_six_numbers_and_symmetric_are_inverses(six: np.ndarray) -> None:
    assert np.array_equal(six_numbers(symmetric(six)), six)


@given(bodies())
def test_every_form_leads_back_to_the_same_body(body: Inertia) -> None:
    again = (
        Inertia.from_ten(body.ten),
        Inertia.from_pseudo(body.pseudo),
        Inertia.about_com(body.mass, body.com, body.inertia_com),
    )
    for other in again:
        assert np.allclose(other.ten, body.ten, atol=1e-12, rtol=1e-10)


@given(bodies())
def test_ten_numbers_are_in_pinocchios_order(body: Inertia) -> None:
    oracle = pin.Inertia(body.mass, np.array(body.com), np.array(body.inertia_com))
    assert np.allclose(oracle.toDynamicParameters(), body.ten, atol=1e-10)
    assert np.allclose(pin.PseudoInertia.FromInertia(oracle).toMatrix(), body.pseudo, atol=1e-10)


@given(bodies(), rotations(), vectors)
def test_moved_is_pinocchios_action(body: Inertia, rotation: np.ndarray, p: np.ndarray) -> None:
    oracle = pin.SE3(rotation, p).act(
        pin.Inertia(body.mass, np.array(body.com), np.array(body.inertia_com))
    )
    moved = body.moved(rotation, p)
    assert np.allclose(moved.ten, oracle.toDynamicParameters(), atol=1e-9)
    back = moved.moved(rotation.T, -rotation.T @ p)
    assert np.allclose(back.ten, body.ten, atol=1e-9)


def test_parallel_axes_by_hand() -> None:
    body = Inertia.about_com(2.0, [1.0, 0.0, 0.0], np.diag([0.1, 0.2, 0.3]))
    assert np.allclose(body.inertia_origin, np.diag([0.1, 2.2, 2.3]))
    assert np.array_equal(body.first_moment, [2.0, 0.0, 0.0])


@given(bodies(), bodies())
def test_joined_bodies_add(one: Inertia, two: Inertia) -> None:
    both = one + two
    assert np.allclose(both.ten, one.ten + two.ten)
    assert np.allclose(both.com * both.mass, one.com * one.mass + two.com * two.mass)


@given(bodies())
def test_a_real_body_has_no_flaw(body: Inertia) -> None:
    assert body.flaw() is None


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (Inertia.from_ten([np.nan] * 10), "not finite"),
        (Inertia.about_com(-1.0, [0, 0, 0], np.eye(3)), "the mass is negative (-1 kg)"),
        (Inertia(0.0, [0.1, 0, 0], np.eye(3)), "the mass is zero but the first moment is not"),
        (Inertia.about_com(1.0, [0, 0, 0], np.diag([-0.1, 1, 1])), "moment of inertia is negative"),
        (Inertia.about_com(1.0, [0, 0, 0], np.diag([0.1, 0.2, 0.5])), "triangle inequality"),
    ],
)
def test_a_flaw_says_why(body: Inertia, words: str) -> None:
    assert words in (body.flaw() or "")


def test_massless_and_point_masses_have_no_flaw() -> None:
    assert Inertia.zero().flaw() is None
    generator = np.random.default_rng(0)
    for centre in generator.normal(size=(200, 3)):
        assert Inertia.about_com(1.9, centre, np.zeros((3, 3))).flaw() is None
    assert np.array_equal(Inertia.zero().com, np.zeros(3))

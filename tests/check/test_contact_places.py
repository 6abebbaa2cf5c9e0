"""Points of contacts that are off, by a dog that a hand holds and whose foot is pushed."""

import re
from pathlib import Path

import numpy as np
import pytest

import steelyard
from floating_logs import FLAG, HAND, IMU, TOE, dog, record
from steelyard.base.arrays import Array
from steelyard.check.decision.small_errors_beside_free_bodies import Bounds, FittedVector
from steelyard.check.finding import Finding, Severity

NOISE, PUSH = 0.05, 30.0


def of_places(file: Path, log: Path) -> Finding:
    found = steelyard.check(file, log).last.findings
    assert not any(f.severity for f in found if f.check != "contact places")
    (one,) = [f for f in found if f.check == "contact places"]
    return one


def declared(folder: Path, point: Array, more: str = "") -> Path:
    assert str(list(TOE)) in FLAG
    flag = FLAG.replace(str(list(TOE)), str(np.round(point, 6).tolist()))
    return dog(folder, IMU + HAND + flag + more)


@pytest.mark.parametrize("seed", range(3))
def test_a_point_of_unknown_force_that_is_off_is_named_with_where_it_is(
    seed: int, tmp_path: Path
) -> None:
    log, _ = record(tmp_path, seed=seed, noise=NOISE, push=PUSH)
    clean = of_places(declared(tmp_path, np.array(TOE)), log)
    assert not clean.severity and clean.answered
    far = np.zeros(3)
    far[seed] = 0.01
    found = of_places(declared(tmp_path, TOE + far), log)
    assert found.severity == Severity.DOUBTFUL and found.fix is not None
    says = found.fix.says
    listed = says[says.index("[") + 1 : says.index("]")].split(", ")
    np.testing.assert_allclose(np.array(listed, dtype=np.float64), TOE, atol=5e-4)
    assert "'fore_foot'" in found.says and "± 0." in found.figure


def test_half_a_centimetre_matters_and_less_does_not(tmp_path: Path) -> None:
    log, _ = record(tmp_path, noise=NOISE, push=PUSH)
    for off, named in ((0.004, False), (0.006, True)):
        file = declared(tmp_path, TOE + np.array([0.0, 0.0, off]))
        assert bool(of_places(file, log).severity) == named


@pytest.mark.slow
def test_the_place_of_a_measured_wrench_is_compared(tmp_path: Path) -> None:
    log, _ = record(tmp_path, noise=NOISE)
    file = dog(tmp_path, IMU + HAND)
    assert not of_places(file, log).severity
    model = tmp_path / "dog.xml"
    text = model.read_text()
    assert 'name="handle" pos="0 0 .1"' in text
    model.write_text(text.replace('name="handle" pos="0 0 .1"', 'name="handle" pos="0 .01 .1"'))
    found = of_places(file, log)
    assert found.severity == Severity.DOUBTFUL and "'handle'" in found.says
    off = [float(x) for x in re.findall(r"[xyz] ([+-][\d.]+) ±", found.figure)]
    assert np.linalg.norm(off) == pytest.approx(10.0, abs=0.5)


def test_a_contact_that_never_touches_is_open_and_the_fit_says_so(tmp_path: Path) -> None:
    log, _ = record(tmp_path, noise=NOISE)
    found = of_places(declared(tmp_path, np.array(TOE)), log)
    assert not found.answered and found.headline and "'fore_foot'" in found.says


def test_a_sole_has_no_point(tmp_path: Path) -> None:
    log, _ = record(tmp_path, noise=NOISE, push=PUSH)
    checked = steelyard.check(declared(tmp_path, np.array(TOE), "sole = true\n"), log).last
    assert not any(f.check == "contact places" for f in checked.findings)


def test_a_vector_counts_along_directions_that_are_known() -> None:
    """Of two directions that are known together, not each, only their mean is."""
    variances = np.diag([1e-8, 1.0, 1e-8])
    turn = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) / np.sqrt(2.0)
    value = np.array([0.02, 0.0, 0.0])
    found = FittedVector.of(value, turn @ variances @ turn.T, 100.0, Bounds(0.005, 0.01))
    np.testing.assert_allclose(found.value, [0.01, 0.01, 0.0], atol=1e-12)
    assert not found.known and found.there and found.least == 0.005
    unseen = FittedVector.of(value, np.diag([np.inf, 1e-8, 1e-8]), 100.0, Bounds(0.005, 0.01))
    assert not unseen.known and not unseen.there and unseen.size == 0.0

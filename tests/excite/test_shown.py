"""What a motion shows: deviations against NumPy, the unseen, and advice."""

from pathlib import Path

import numpy as np
import pytest

from excite.tabled import OPEN, arm, designed
from steelyard.excite import predicted_accuracy_and_advice as advice
from steelyard.excite.excite import DesignedMotion
from steelyard.excite.predicted_accuracy_and_advice import deviations

ANY = f'{OPEN}[excitation.limits]\neffort = "any"\n'


@pytest.mark.parametrize("seed", range(5))
def test_deviations_are_those_of_the_inverse(seed: int) -> None:
    random = np.random.default_rng(seed)
    root = random.standard_normal((30, 9)) * 10.0 ** random.uniform(-4.0, 4.0, 9)
    gram = root.T @ root
    scale = np.sqrt(np.diag(gram))
    expected = np.sqrt(np.diag(np.linalg.inv(gram / scale[:, None] / scale))) / scale
    np.testing.assert_allclose(deviations(gram), expected, rtol=1e-8)


def test_what_is_not_distinguished_is_infinite_and_the_rest_is_not() -> None:
    random = np.random.default_rng(0)
    root = random.standard_normal((30, 6))
    root[:, 1] = 0.0
    root[:, 4] = 2.0 * root[:, 3]
    found = deviations(root.T @ root)
    assert np.isinf(found[[1, 3, 4]]).all()
    alone = np.delete(root, [1, 4], axis=1)
    expected = np.sqrt(np.diag(np.linalg.inv(alone.T @ alone)))
    np.testing.assert_allclose(found[[0, 2, 5]], expected[[0, 1, 3]], rtol=1e-8)
    assert np.isinf(deviations(np.zeros((3, 3)))).all()


def test_prior_information_makes_the_unseen_known() -> None:
    from steelyard.excite.predicted_accuracy_and_advice import PredictedAccuracy

    gram = np.diag([4.0, 0.0])
    shown = PredictedAccuracy(("a", "b"), ("", ""), gram, 1.0, 1.0, 1.0, np.ones(2))
    np.testing.assert_array_equal(shown.std(), [0.5, np.inf])
    np.testing.assert_allclose(shown.std(np.diag([0.0, 25.0])), [0.5, 0.2])


def test_advice_adds_information(tmp_path: Path) -> None:
    found = designed(tmp_path, f"{ANY}[excitation.motion]\nperiod = 4.0\nharmonics = 3\n")
    before = found.shown.std()
    again, *others = found.advice
    assert (again.what, again.seconds) == ("repeating the motion", 4.0)
    np.testing.assert_allclose(again.std, before / 2.0**0.5, rtol=1e-9)
    assert len(again.helps) == len(before)
    assert [one.what for one in others] == [
        "one joint after another at three speeds, if the workspace allows it",
        "20 static postures, if the workspace allows it",
    ]
    for one in others:
        assert np.all(one.std <= before * (1.0 + 1e-9))
        shares = [share for _, share in one.helps]
        assert shares == sorted(shares) and all(share < 0.8 for share in shares)
        names = dict(zip(found.shown.names, one.std / before, strict=True))
        for name, share in one.helps:
            assert share == pytest.approx(names[name])


@pytest.mark.slow
def test_other_motions_of_many_joints_are_looked_at_in_few_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = f"{ANY}[excitation.motion]\nperiod = 4.0\nharmonics = 3\n"
    wide = designed(tmp_path, tables).advice[1]
    monkeypatch.setattr(advice, "ENOUGH_ADVICE_SAMPLES", 400)
    few = designed(tmp_path, tables).advice[1]
    assert wide.seconds == few.seconds > 400 / advice.SAMPLES_A_SECOND
    np.testing.assert_allclose(few.std, wide.std, rtol=0.05)
    assert np.any(few.std != wide.std)


def test_one_joint_at_a_time_leaves_parameters_unseen(tmp_path: Path) -> None:
    tables = f'{ANY}[excitation.motion]\nkind = "sweeps"\nspeeds = 1\nslowest = 1.0\n'
    found = designed(tmp_path, tables)
    std = found.shown.std()
    assert not np.isnan(std).any() and np.isinf(std).any()
    for one in found.advice:
        assert not np.isnan(one.std).any()
        assert all(np.isfinite(share) for _, share in one.helps)
    printed = DesignedMotion(found, arm(tmp_path)).to_dict()
    assert printed["figure"] is None and None in printed["predicted_std"].values()

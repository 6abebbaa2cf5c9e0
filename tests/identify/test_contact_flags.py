"""A robot that is pushed by a force that is not measured, from logs to a model."""

from pathlib import Path

import numpy as np
import pytest

import steelyard
from floating_logs import FLAG, HAND, IMU, dog, record
from steelyard.base.errors import DataError

NOISE, PUSH, MASS = 0.05, 30.0, 7.2


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    folder = tmp_path_factory.mktemp("pushed")
    first, second = (record(folder, f"log{k}", seed=k, noise=NOISE, push=PUSH)[0] for k in range(2))
    return dog(folder, IMU + HAND + FLAG), str(first), f"{second}@2:18"


@pytest.mark.slow
@pytest.mark.parametrize("method", ["WLS", "Huber"])
def test_an_unknown_force_does_not_spoil_the_model(
    method: str, logs: tuple[Path, str, str]
) -> None:
    file, first, unseen = logs
    found = steelyard.identify(file, first, unseen, method=method)
    model = found.model
    assert any("forces of contacts are not measured" in note for note in found.content.notes)
    prior = model.model.prior
    assert prior is not None
    true = dict(
        zip(model.base.base_names, model.base.base_values(prior.values.values), strict=True)
    )
    estimate = model.estimate
    off = {
        name: abs(value - true[name]) / half
        for name, value, half in zip(
            estimate.parameters.names, estimate.parameters.values, estimate.half_width, strict=True
        )
        if half > 0.0
    }
    assert off["m.trunk"] < 2.0 and true["m.trunk"] == pytest.approx(MASS)
    assert np.mean(np.array(list(off.values())) < 1.0) > 0.8
    (score,) = found.content.scores
    assert all(joint.error < 2.0 * NOISE for joint in score.errors.joints)


@pytest.mark.slow
def test_the_model_keeps_how_forces_are_taken_out(
    logs: tuple[Path, str, str], tmp_path: Path
) -> None:
    file, first, unseen = logs
    found = steelyard.identify(file, first, method="least_squares")
    base = found.model.signals.base
    assert base is not None and len(base.spread) == 10 and len(set(base.spread)) == 10
    found.save(tmp_path / "model")
    again = steelyard.load_model(tmp_path / "model")
    assert again.signals.base == base
    (score,) = steelyard.validate(again, unseen).content.scores
    assert score.errors.joints[6].error < 2.0 * NOISE


def test_noise_of_the_motion_is_not_followed_through_combined_rows(
    logs: tuple[Path, str, str],
) -> None:
    file, first, _ = logs
    with pytest.raises(DataError, match="forces of contacts were taken out"):
        steelyard.identify(file, first, method="ML")

"""Models of floating bases on which forces act that are not measured."""

from pathlib import Path

import pytest

import steelyard
from floating_logs import FLAG, HAND, IMU, dog, record
from steelyard.base.errors import ModelError

UNKNOWN = 'wrench = "unknown"\n'


def test_an_unknown_wrench_beside_a_flag(tmp_path: Path) -> None:
    """The base rows, which it spoils, say nothing of the contact's force, nor of the robot."""
    fitted, unseen = (
        record(tmp_path, name, seed=seed, noise=0.02, push=30.0)[0]
        for seed, name in enumerate(("fit", "unseen"))
    )
    found = steelyard.identify(dog(tmp_path, IMU + UNKNOWN + FLAG), fitted, unseen, check=False)
    error = found.scores.table[-1]
    assert found.verdict.level == "good", error
    assert "No drift" in steelyard.health(found.model, [unseen]).headline
    payload = steelyard.identify_payload(found.model, unseen, frame="hind_calf")
    assert abs(payload.ten[0]) < 0.02
    with pytest.raises(ModelError, match="not measured"):
        steelyard.external_wrench(found.model, unseen, "hind_foot")


@pytest.mark.parametrize(
    ("more", "prior", "says"),
    [
        (FLAG.replace("threshold = 2.0", "threshold = -1.0"), "", "fore_foot always touches"),
        (FLAG.replace("threshold = 2.0", "threshold = 1e3"), "", "fore_foot never touches"),
        ("", '[prior]\nsymmetry = "yz"\n', "data contradict the prior constraints"),
    ],
)
def test_what_is_doubtful_stands_beside_the_headline(
    tmp_path: Path, more: str, prior: str, says: str
) -> None:
    log, _ = record(tmp_path, noise=0.02, push=30.0)
    if prior:  # fore and hind legs that are no mirror images
        file = dog(tmp_path, IMU + HAND + FLAG, prior)
        model = tmp_path / "dog.xml"
        model.write_text(model.read_text().replace('mass="0.4"', 'mass="0.5"', 1))
    else:
        file = dog(tmp_path, IMU + HAND + more)
    found = steelyard.identify(file, log, check=False)
    assert any(says in one.text for one in found.verdict.limitations)

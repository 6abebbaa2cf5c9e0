"""Logs whose contact forces are not measured: what is not checked is said."""

from pathlib import Path

import steelyard
from floating_logs import FLAG, HAND, IMU, dog, record


def test_what_no_model_says_is_open_and_stands_in_the_headline(tmp_path: Path) -> None:
    """Sensors are checked, order and signs are not; the fit says so."""
    log, _ = record(tmp_path, push=30.0)
    file = dog(tmp_path, IMU + FLAG + HAND)
    found = steelyard.check(file, log).last
    (said,) = (f for f in found.findings if "contacts are not measured" in f.says)
    assert not said.answered and not any(f.check == "joint order" for f in found.findings)
    assert any(f.check == "sensors of the base" and f.answered for f in found.findings)
    verdict = steelyard.identify(file, log).verdict
    assert any("contacts are not measured" in one.text for one in verdict.limitations)

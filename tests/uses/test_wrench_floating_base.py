"""The wrench on a link of a robot with a floating base."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from floating_logs import FLAG, HAND, IMU, dog, record
from steelyard.base.errors import ModelError


def test_a_push_that_no_sensor_measures(tmp_path: Path) -> None:
    """A hand pushes harder than its sensor says: the rest is the wrench, base rows included."""
    fitted, _ = record(tmp_path, noise=0.02)
    model = steelyard.identify(dog(tmp_path, IMU + HAND), fitted, check=False).model
    log, motion = record(tmp_path, "other", seed=1, noise=0.02)
    table = pl.read_parquet(log)
    push = 6.0 * np.sin(np.pi * np.clip((motion.t - 5.0) / 2.0, 0.0, 1.0)) ** 2
    table.with_columns(pl.col("hand_fy") - pl.Series(push)).write_parquet(log)
    found = steelyard.external_wrench(model, log, "handle")
    estimate = found.estimate
    true = np.interp(estimate.t, motion.t - motion.t[0], push)
    off = np.abs(estimate.wrench[:, 1] - true)
    assert estimate.residual == "torque" and estimate.joints[:3] == ("base_x", "base_y", "base_z")
    assert (off <= estimate.half_width[:, 1]).mean() >= 0.95
    assert abs(estimate.wrench[estimate.largest, 1] - 6.0) < 0.5
    with pytest.raises(ModelError, match="momentum"):
        steelyard.external_wrench(model, log, "handle", residual="momentum")


def test_contacts_of_unknown_force_are_refused(tmp_path: Path) -> None:
    """What they do would look like a push."""
    log, _ = record(tmp_path, push=30.0)
    model = steelyard.identify(dog(tmp_path, IMU + FLAG + HAND), log, check=False).model
    with pytest.raises(ModelError, match="forces of contacts are not measured"):
        steelyard.external_wrench(model, log)


def test_a_payload_is_on_the_base(tmp_path: Path) -> None:
    """A robot that floats has no end; rows of its base may be zero."""
    log, _ = record(tmp_path, noise=0.02)
    model = steelyard.identify(dog(tmp_path, IMU + HAND), log, check=False).model
    found = steelyard.identify_payload(model, log)
    assert found.frame == "trunk" and abs(found.ten[0]) < 0.05

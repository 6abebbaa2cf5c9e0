"""A bias of the accelerometer of a dog that a hand holds and whose foot is pushed."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from floating_logs import FLAG, HAND, IMU, TRACKED, dog, record
from steelyard.base.arrays import Array
from steelyard.check.finding import Finding, Severity

NOISE, PUSH = 0.05, 30.0
BIAS = np.array([0.06, -0.05, 0.07])


def biased(folder: Path, bias: Array, seed: int = 0) -> Path:
    log, _ = record(folder, seed=seed, noise=NOISE, push=PUSH)
    frame = pl.read_parquet(log)
    shown = (pl.col(f"acc_{x}") + b for x, b in zip("xyz", bias, strict=True))
    frame.with_columns(*shown).write_parquet(log)
    return log


def of_bias(file: Path, log: Path) -> Finding:
    found = steelyard.check(file, log).last.findings
    assert not any(f.severity for f in found if f.check != "accelerometer bias")
    (one,) = [f for f in found if f.check == "accelerometer bias"]
    return one


@pytest.mark.parametrize("seed", range(3))
def test_a_bias_is_named_and_gone_once_it_is_stated(seed: int, tmp_path: Path) -> None:
    log = biased(tmp_path, BIAS, seed)
    found = of_bias(dog(tmp_path, IMU + HAND + FLAG), log)
    assert found.severity == Severity.DOUBTFUL and found.fix is not None
    (listed,) = re.findall(r"acceleration_bias = \[(.*)\]", found.fix.says)
    fitted = np.array(listed.split(", "), dtype=np.float64)
    np.testing.assert_allclose(fitted, BIAS, atol=0.01)
    stated = IMU + f"acceleration_bias = {fitted.tolist()}\n"
    after = of_bias(dog(tmp_path, stated + HAND + FLAG), log)
    assert not after.severity and after.headline and "would not be seen" in after.says


def test_a_clean_log_says_what_is_not_seen(tmp_path: Path) -> None:
    log = biased(tmp_path, np.zeros(3))
    found = of_bias(dog(tmp_path, IMU + HAND + FLAG), log)
    assert not found.severity and not found.answered and found.headline
    assert "below 0.05 m/s²" in found.says and "0.52\u00a0% of all masses" in found.says


@pytest.mark.slow
def test_a_bias_is_found_beside_measured_forces_too(tmp_path: Path) -> None:
    log, _ = record(tmp_path, noise=NOISE)
    frame = pl.read_parquet(log)
    frame.with_columns(pl.col("acc_y") + 0.1).write_parquet(log)
    found = of_bias(dog(tmp_path, IMU + HAND), log)
    assert found.severity == Severity.DOUBTFUL and "y +0.1" in found.figure


@pytest.mark.slow
def test_motion_capture_has_no_accelerometer(tmp_path: Path) -> None:
    log = biased(tmp_path, BIAS)
    found = steelyard.check(dog(tmp_path, TRACKED + HAND + FLAG), log).last.findings
    assert not any(f.check == "accelerometer bias" for f in found)

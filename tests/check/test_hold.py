"""Samples that are held for several rows of a log are found, and their effect is reported."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from check.conftest import Arm
from check.test_signals import DQ, ROBOT, TAU, Q, case_of, coarse, diagnosis, sound
from steelyard.base.arrays import Array
from steelyard.check.finding import Edit, Finding, Severity
from steelyard.check.signals.corrupt_and_repeated_rows import repeated_rows_check, zero_order_hold
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_edits import edited
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording

DELAY = ("signals", "effort", "delay")
MOTION = slice(Q.start, DQ.stop)
OK, DOUBTFUL = Severity.OK, Severity.DOUBTFUL


def with_hold(table: Array, every: int, *columns: slice, phase: int = 0) -> Array:
    """A table whose columns are new only every so many rows."""
    rows = np.arange(len(table))
    source = np.maximum((rows - phase) // every * every + phase, 0)
    changed = table.copy()
    for column in columns:
        changed[:, column] = table[source, column]
    return changed


def findings_of(folder: Path, table: Array) -> tuple[Finding, ...]:
    return repeated_rows_check(case_of(folder, table))


@pytest.mark.parametrize(
    ("rate", "every", "severity"),
    [(100.0, 2, DOUBTFUL), (500.0, 2, OK), (500.0, 3, OK), (500.0, 6, DOUBTFUL)],
)
def test_held_efforts_are_late(tmp_path: Path, rate: float, every: int, severity: int) -> None:
    motion, found = findings_of(tmp_path, with_hold(sound(rate), every, TAU))
    late = 0.5 * (every - 1) / rate
    assert motion.says == "no row in motion repeats the previous one"
    assert found.says == (
        f"efforts are updated every {every} rows ({rate / every:.3g} Hz of {rate:.3g} Hz): "
        f"they are {1e3 * late:.2g} ms late on average"
    )
    assert found.severity == severity
    edits = () if found.fix is None else found.fix.edits
    assert edits == ((Edit(DELAY, pytest.approx(late, rel=0.01)),) if severity else ())


@pytest.mark.parametrize(
    ("rate", "every", "severity", "does"),
    [
        (100.0, 2, DOUBTFUL, "repeated rows are interpolated"),
        (500.0, 2, OK, "repeated rows are interpolated"),
        (500.0, 3, OK, "repeated rows are interpolated"),
        (500.0, 6, DOUBTFUL, "they are 5 ms late on average, and rows are not interpolated"),
        (2000.0, 6, DOUBTFUL, "they are 1.2 ms late on average, and rows are not interpolated"),
    ],
)
@pytest.mark.parametrize("columns", [(Q,), (MOTION,)])
def test_held_positions_are_bridged_or_late(
    tmp_path: Path, rate: float, every: int, severity: int, does: str, columns: tuple[slice, ...]
) -> None:
    (found,) = findings_of(tmp_path, with_hold(sound(rate), every, *columns))
    assert found.says == (
        f"positions are updated every {every} rows ({rate / every:.3g} Hz of {rate:.3g} Hz): {does}"
    )
    assert found.severity == severity
    assert found.fix is None or found.fix.edits == ()


@pytest.mark.parametrize("every", [2, 3, 6])
def test_efforts_held_in_the_rows_of_the_positions_are_not_late(tmp_path: Path, every: int) -> None:
    motion, effort = findings_of(tmp_path, with_hold(sound(500.0), every, MOTION, TAU))
    assert motion.says.startswith(f"positions are updated every {every} rows")
    assert effort.says.endswith("no later than positions") and effort.severity == OK


def test_efforts_held_in_other_rows_than_positions_are_late(tmp_path: Path) -> None:
    table = with_hold(with_hold(sound(), 2, MOTION), 2, TAU, phase=1)
    _, effort = findings_of(tmp_path, table)
    assert effort.says.endswith("they are 5 ms late on average")


def test_joints_that_are_read_in_turn_are_not_bridged(tmp_path: Path) -> None:
    table = with_hold(with_hold(sound(), 2, slice(1, 3)), 2, slice(3, 4), phase=1)
    (found,) = findings_of(tmp_path, table)
    assert found.says.endswith("they are 5 ms late on average, and rows are not interpolated")


def test_the_delay_that_is_proposed_corrects_the_robot_file(tmp_path: Path) -> None:
    table = with_hold(sound(), 2, TAU)
    found = diagnosis(tmp_path, table)
    assert [f.check for f in found.findings if f.severity] == ["repeats"]
    corrected = diagnosis(tmp_path, table, edited(ROBOT, found.edits))
    assert corrected.severity == OK
    says = [f.says for f in corrected.findings if f.check == "repeats"][-1]
    assert says.endswith("5 ms late on average ([signals.effort] delay compensates 5 ms)")


def test_repeated_rows_that_are_kept_leave_positions_late(tmp_path: Path) -> None:
    case = case_of(tmp_path, with_hold(sound(), 2, MOTION))
    kept = replace(case.logs[0], processing=Processing(bridge_repeats=False))
    (found,) = repeated_rows_check(replace(case, logs=(kept,)))
    assert found.says.endswith("they are 5 ms late on average, and rows are not interpolated")


def no_noise(table: Array) -> Array:
    clean = table.copy()
    t = clean[:, 0] = np.arange(len(table)) / 100.0
    clean[:, Q] = np.sin(t)[:, None] * [0.5, 0.8, 1.1]
    clean[:, DQ] = np.cos(t)[:, None] * [0.5, 0.8, 1.1]
    clean[:, TAU] = 20.0 * np.cos(clean[:, Q]) + 3.0 * clean[:, DQ]
    return clean


def coarse_encoder(table: Array) -> Array:
    changed = table.copy()
    changed[:, Q] = np.round(table[:, Q] / 0.01) * 0.01
    return changed


def resting(table: Array) -> Array:
    changed = table.copy()
    changed[:, 1:] = table[0, 1:]
    return changed


def switching(table: Array) -> Array:
    changed = table.copy()
    changed[:, TAU] = 5.0 * np.sign(changed[:, DQ])
    return changed


@pytest.mark.parametrize("change", [no_noise, coarse_encoder, coarse, resting, switching])
@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_coarse_resting_and_noise_free_logs_hold_nothing(
    tmp_path: Path, change: object, rate: float
) -> None:
    assert callable(change)
    assert not any(" are new every" in f.says for f in findings_of(tmp_path, change(sound(rate))))


@pytest.mark.parametrize("every", [2, 3])
def test_the_proposed_delay_improves_a_fit(arm: Arm, every: int) -> None:
    """Held efforts, fitted with the delay, are closer to what the arm truly needs."""
    loaded = load_robot(arm.path)
    assert loaded.signals is not None
    efforts = slice(1 + 2 * arm.motion.n_joints, None)
    log = LogInMemory(Path("held"), arm.columns, with_hold(arm.table, every, efforts))
    regressor = base_regressor(arm.reference.model)
    sigma = []
    for delay in (0.0, 0.5 * (every - 1) * 0.005):
        recording = Recording(log, replace(loaded.signals, effort_delay=delay))
        sigma.append(
            WeightedLeastSquares()(gather(regressor, prepare(recording, Processing()))).sigma
        )
    assert np.mean(sigma[1] / sigma[0]) < 0.85


WITHOUT_HOLD = (
    "kinova_gen3",
    "krang_lwa3",
    "med7",
    "panda",
    "rokae_ar5",
    "so101",
    "tiago",
    "tx40",
    "ur10",
    "ur10e",
)
"""Robots whose logs have a new sample in every row."""


@pytest.mark.parametrize("robot", WITHOUT_HOLD)
def test_no_column_of_a_real_log_is_held(robot: str) -> None:
    data = os.environ.get("STEELYARD_DATA")
    if not data:
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    paths = sorted((Path(data) / robot).rglob("*.parquet"))
    assert paths
    for path in paths:
        table = pl.read_parquet(path)
        for name in table.columns:
            x = table[name].to_numpy().astype(np.float64)
            x = x[np.isfinite(x)]
            change = np.abs(np.diff(x))
            step = change[change > 0.0].min(initial=np.inf)
            assert zero_order_hold(x[:, None], np.array([step])).every == 1, (path.name, name)

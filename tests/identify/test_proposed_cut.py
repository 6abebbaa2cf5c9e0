"""A single log is cut where its motion is new, and only while something moves."""

from pathlib import Path

import polars as pl
import pytest

from short_arm import without_wrist
from steelyard.base.motion import run
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.repeated_motion_and_validation_split import ProposedCut, propose_cut
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors


def recorded(robot: Robot, period: float, periods: int, folder: Path) -> Path:
    """A log of a periodic motion, with rests of one second before and after it."""
    truth = random_truth(robot, 0)
    rig = VirtualRobot(robot, truth, customary_sensors(robot, truth), seed=0)
    run(rig, random_fourier(robot, seed=3, period=period, periods=periods), folder / "log.csv")
    return folder / "log.csv"


@pytest.mark.slow
@pytest.mark.parametrize(("period", "periods"), [(6.0, 2), (9.0, 1)])
def test_the_second_part_ends_with_the_first_round(
    period: float, periods: int, tmp_path: Path
) -> None:
    robot = without_wrist(tmp_path)
    log = recorded(robot.robot, period, periods, tmp_path)
    found = propose_cut(robot, [str(log)])
    first, second = found.logs
    assert first.startswith(f"{log}@0:") and second.startswith(f"{log}@{first.rsplit(':')[-1]}:")
    end = float(second.rsplit(":")[-1])
    assert end == pytest.approx(1.0 + period, abs=0.35)
    assert found.ends == (
        f"rows after {end:g} s are left out: the motion repeats" if periods > 1 else ""
    )
    assert float(first.rsplit(":")[-1]) == pytest.approx(1.0 + 0.7 * period, abs=0.3)
    assert propose_cut(robot, [f"{log}@{second.rsplit('@')[-1]}"]) == ProposedCut((second,))


@pytest.mark.slow
def test_a_log_whose_motion_repeats_early_is_left_whole(tmp_path: Path) -> None:
    robot = without_wrist(tmp_path)
    log = recorded(robot.robot, 2.0, 5, tmp_path)
    assert propose_cut(robot, [str(log)]) == ProposedCut((str(log),))


@pytest.mark.slow
def test_a_long_rest_before_the_motion_counts_for_neither_part(tmp_path: Path) -> None:
    robot = without_wrist(tmp_path)
    log = recorded(robot.robot, 9.0, 1, tmp_path)
    rows = pl.read_csv(log)
    later = rows.with_columns(pl.col("time_s") + 30.0)
    rest = pl.concat([rows[:1].with_columns(pl.lit(0.01 * k).alias("time_s")) for k in range(2990)])
    still = pl.concat(
        [rows[-1:].with_columns(pl.lit(41.1 + 0.01 * k).alias("time_s")) for k in range(500)]
    )
    pl.concat([rest, later, still]).write_csv(log)
    found = propose_cut(robot, [str(log)])
    first, second = found.logs
    begin, end = (float(x) for x in second.rpartition("@")[2].split(":"))
    assert found.ends == f"rows after {end:g} s are left out: no joint moves"
    assert first == f"{log}@0:{begin:g}"
    assert begin == pytest.approx(31.0 + 0.7 * 9.0, abs=0.4)
    assert end == pytest.approx(40.0, abs=0.4)

import numpy as np
import pytest

from steelyard.base.errors import DataError
from steelyard.robot.robot import Robot
from steelyard.simulate.drives_sensors_and_loads import Sensors, TrueRun


def run(n: int, ticks: int = 40_001) -> TrueRun:
    t = np.arange(ticks) * 1e-3
    wave = np.sin(t[:, None] * np.linspace(0.3, 0.9, n))
    none = 0.0 * wave
    effort = 10.0 * wave
    return TrueRun(t, wave, 2.0 * wave, effort, none, none, np.zeros((3, 0, 0)), None)


def read(sensors: Sensors, robot: Robot, seed: int = 0) -> dict[str, np.ndarray]:
    return sensors.read(run(robot.n), robot, np.random.default_rng(seed))


def stacked(columns: dict[str, np.ndarray], kind: str) -> np.ndarray:
    return np.column_stack([v for k, v in columns.items() if k.startswith(kind)])


def test_perfect_sensors_show_what_happened(arm: Robot) -> None:
    columns, true = read(Sensors(rate=1000.0), arm), run(6)
    np.testing.assert_array_equal(columns["time_s"], true.t)
    np.testing.assert_array_equal(stacked(columns, "q"), true.q)
    np.testing.assert_array_equal(stacked(columns, "dq"), true.dq)
    np.testing.assert_array_equal(stacked(columns, "tau"), true.tau)


def test_names_carry_units(tree: Robot) -> None:
    names = list(read(Sensors(), tree))
    assert names == [
        "time_s",
        *("q1_rad", "q2_m", "q3_rad", "q4_rad"),
        *("dq1_rad_s", "dq2_m_s", "dq3_rad_s", "dq4_rad_s"),
        *("tau1_Nm", "tau2_N", "tau3_Nm", "tau4_Nm"),
    ]


def test_velocity_columns_can_be_absent(tree: Robot) -> None:
    names = list(read(Sensors(velocity=False), tree))
    assert len(names) == 9 and not any(name.startswith("dq") for name in names)


def test_gains_make_currents(arm: Robot) -> None:
    gains = np.array([12.0, 12.0, 10.0, 11.0, -11.0, 11.0])
    noise = 0.1
    plain = read(Sensors(torque_noise=noise), arm)
    columns = read(Sensors(gains=gains, torque_noise=noise), arm)
    assert "current6_A" in columns and "tau1_Nm" not in columns
    np.testing.assert_allclose(stacked(columns, "current") * gains, stacked(plain, "tau"))


def test_rate_takes_every_nth_tick(arm: Robot) -> None:
    columns, true = read(Sensors(rate=125.0), arm), run(6)
    np.testing.assert_array_equal(columns["time_s"], true.t[::8])
    np.testing.assert_array_equal(columns["q3_rad"], true.q[::8, 2])


@pytest.mark.parametrize("rate", [33.333, 1.0 / 0.03, 300.0, 47.5])
def test_rows_lie_between_ticks_where_the_rate_wants_them(rate: float, arm: Robot) -> None:
    columns = read(Sensors(rate=rate), arm)
    t = columns["time_s"]
    np.testing.assert_allclose(t, np.arange(len(t)) / rate, rtol=0.0, atol=1e-9)
    assert 40.0 - 1.0 / rate < t[-1] <= 40.0
    wave = np.sin(t[:, None] * np.linspace(0.3, 0.9, 6))
    # a line between ticks of 1 ms leaves an arc of at most 1e-6 / 8 of the second derivative
    np.testing.assert_allclose(stacked(columns, "q"), wave, rtol=0.0, atol=0.81e-6 / 8.0)
    np.testing.assert_allclose(stacked(columns, "tau"), 10.0 * wave, rtol=0.0, atol=8.1e-6 / 8.0)


@pytest.mark.parametrize("rate", [0.0, -5.0, 2000.0, np.nan])
def test_rates_above_that_of_the_controller_are_refused(rate: float) -> None:
    with pytest.raises(DataError, match="rows a second"):
        Sensors(rate=rate)


def test_positions_lie_on_the_encoders_steps(arm: Robot) -> None:
    steps = np.array([1e-3, 2e-3, 5e-4, 1e-2, 0.0, 1e-3])
    q, true = stacked(read(Sensors(rate=1000.0, resolution=steps), arm), "q"), run(6).q
    error = np.abs(q - true).max(axis=0)
    counts = q[:, :4] / steps[:4]
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert np.all(error <= 0.5 * steps + 1e-12)
    assert np.all(error[steps > 0] > 0.45 * steps[steps > 0])


def test_noise_is_white_and_as_large_as_requested(arm: Robot) -> None:
    std = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.0])
    sensors = Sensors(rate=1000.0, torque_noise=std, velocity_noise=0.01, position_noise=1e-4)
    columns, true = read(sensors, arm), run(6)
    torque = stacked(columns, "tau") - true.tau
    np.testing.assert_allclose(torque.std(axis=0), std, rtol=0.02)
    np.testing.assert_allclose((stacked(columns, "dq") - true.dq).std(axis=0), 0.01, rtol=0.02)
    np.testing.assert_allclose((stacked(columns, "q") - true.q).std(axis=0), 1e-4, rtol=0.02)
    correlation = np.corrcoef(np.vstack([torque[:-1, :5].T, torque[1:, :5].T]))
    assert np.abs(correlation - np.eye(10)).max() < 0.03


def test_clock_jitters_but_advances(arm: Robot) -> None:
    true = run(6).t
    slight = read(Sensors(rate=1000.0, clock_jitter=1e-4), arm)["time_s"] - true
    assert slight.std() == pytest.approx(1e-4, rel=0.02)
    wild = read(Sensors(rate=1000.0, clock_jitter=1e-2), arm)["time_s"]
    assert np.all(np.diff(wild) > 0.0)


@pytest.mark.parametrize("name", ["resolution", "torque_noise", "clock_jitter"])
def test_negative_sizes_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is negative"):
        Sensors(**{name: -1.0})


def test_zero_gain_is_refused() -> None:
    with pytest.raises(ValueError, match="gain is zero"):
        Sensors(gains=[1.0, 0.0])

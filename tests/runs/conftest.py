"""Logs of invented motions, and the real ones if they are there."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.arrays import frozen
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import parse_log_argument
from steelyard.robot.file.signals import Signals
from steelyard.runs.recording import Recording

Arrays = dict[str, np.ndarray]
Make = Callable[..., Recording]


def signals_of(
    position: list[str],
    effort: list[str],
    velocity: list[str] | None = None,
    unit: str = "Nm",
    position_scale: float = 1.0,
    time_scale: float = 1.0,
) -> Signals:
    n = len(position)
    return Signals(
        time="t" if position[0].startswith("q_") else "time_s",
        time_scale=time_scale,
        position=tuple(position),
        position_scale=frozen(np.full(n, position_scale)),
        velocity=None if velocity is None else tuple(velocity),
        velocity_scale=None if velocity is None else frozen(np.ones(n)),
        effort=tuple(effort),
        effort_scale=frozen(np.ones(n)),
        effort_kind="motor_current" if unit == "A" else "joint_torque",
        effort_units=(unit,) * n,
        gains=frozen(np.ones(n)),
    )


@pytest.fixture
def sines() -> Callable[[np.ndarray], Arrays]:
    """Two joints on sines of 0.2 to 1.1 Hz and their exact derivatives, `(N, 2)`."""

    def motion(t: np.ndarray) -> Arrays:
        w = 2.0 * np.pi * np.array([[0.2, 0.5], [0.3, 1.1]])
        a = np.array([[0.6, 0.2], [0.5, 0.1]])
        phase = w[None] * t[:, None, None]
        return {
            "q": (a * np.sin(phase)).sum(axis=2),
            "dq": (a * w * np.cos(phase)).sum(axis=2),
            "ddq": (-a * w**2 * np.sin(phase)).sum(axis=2),
            "effort": (3.0 * a * np.cos(phase + 0.3)).sum(axis=2),
        }

    return motion


@pytest.fixture
def recording(tmp_path: Path) -> Make:
    """Writes a log of `t`, `q`, `effort` (and `dq`) and opens it with a window behind its name."""

    def make(
        t: np.ndarray,
        q: np.ndarray,
        effort: np.ndarray,
        dq: np.ndarray | None = None,
        window: str = "",
        suffix: str = ".parquet",
        **scales: float,
    ) -> Recording:
        n = q.shape[1]
        frame = {"t": t}
        frame |= {f"q_{j}": q[:, j] for j in range(n)}
        frame |= {f"tau_{j}": effort[:, j] for j in range(n)}
        if dq is not None:
            frame |= {f"dq_{j}": dq[:, j] for j in range(n)}
        path = tmp_path / f"run{suffix}"
        table = pl.DataFrame(frame)
        if suffix == ".parquet":
            table.write_parquet(path, row_group_size=1000)
        else:
            table.write_csv(path)
        signals = signals_of(
            [f"q_{j}" for j in range(n)],
            [f"tau_{j}" for j in range(n)],
            None if dq is None else [f"dq_{j}" for j in range(n)],
            **scales,  # type: ignore[arg-type]
        )
        path, cut = parse_log_argument(f"{path}{window}")
        return Recording(open_log(path), signals, cut)

    return make


@pytest.fixture
def real() -> Callable[[str], Recording]:
    """Recordings of the public data sets, by path and window."""
    folder = os.environ.get("STEELYARD_DATA")
    if folder is None:
        pytest.skip("STEELYARD_DATA does not name the folder of the real logs")
    arms = {
        "ur10e": ("q{}_rad", "current{}_A", "dq{}_rad_s", 6),
        "panda": ("q{}_rad", "tau{}_Nm", None, 7),
        "rokae_ar5": ("q{}_rad", "tau{}_Nm", None, 7),
        "tiago": ("q_arm{}_rad", "current_arm{}_A", None, 4),
    }

    def open_real(argument: str) -> Recording:
        q, effort, dq, n = arms[argument.split("/")[0]]
        numbers = range(1, n + 1)
        signals = signals_of(
            [q.format(j) for j in numbers],
            [effort.format(j) for j in numbers],
            None if dq is None else [dq.format(j) for j in numbers],
            "A" if "current" in effort else "Nm",
        )
        if not signals.time.endswith("_s"):
            signals = Signals(**{**vars(signals), "time": "time_s"})
        path, cut = parse_log_argument(f"{folder}/{argument}")
        return Recording(open_log(path), signals, cut)

    return open_real
